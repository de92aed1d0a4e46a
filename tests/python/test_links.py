"""Lossy links around environments of others."""

import numpy as np
import pytest
from gymnasium import spaces
from mpe2 import simple_reference_v3, simple_speaker_listener_v4, simple_spread_v3, simple_tag_v3
from pettingzoo.test import parallel_api_test, parallel_seed_test
from pettingzoo.utils import parallel_to_aec
from vamaro_swarm import AgentError, LossyLinks
from vamaro_swarm.values import of

MPE = [simple_spread_v3, simple_tag_v3, simple_reference_v3, simple_speaker_listener_v4]


def random_actions(env, rng):
    for agent in env.possible_agents:
        env.action_space(agent).seed(int(rng.integers(1 << 30)))
    return {agent: env.action_space(agent).sample() for agent in env.agents}


def beside(make, steps=6, **options):
    """The same episode with links and without, step by step: what is observed, the infos, and the truth."""
    env, plain, rng = LossyLinks(make(), **options), make(), np.random.default_rng(0)
    observed, infos = env.reset(seed=7)
    truth, _ = plain.reset(seed=7)
    yield observed, infos, truth
    for _ in range(steps - 1):
        actions = random_actions(plain, rng)
        observed, rewards, *_, infos = env.step(actions)
        truth, earned, *_ = plain.step(actions)
        assert rewards == earned
        yield observed, infos, truth


@pytest.mark.parametrize("module", MPE, ids=lambda module: module.__name__.split(".")[-1])
def test_any_environment_with_vectors_keeps_the_api(module):
    make = lambda: LossyLinks(module.parallel_env(max_cycles=10), p=0.4, links="delay(1)")
    parallel_api_test(make(), num_cycles=30)
    parallel_seed_test(make, num_cycles=10)


@pytest.mark.parametrize("module", MPE, ids=lambda module: module.__name__.split(".")[-1])
def test_own_parts_are_exact_and_others_are_held(module):
    agents = module.parallel_env().possible_agents
    for step, (observed, infos, truth) in enumerate(beside(module.parallel_env, p=0.3)):
        if not step:
            known = {agent: dict(truth) for agent in agents}
        for agent in agents:
            arrived = {sender for sender, mask in zip(agents, infos[agent]["mask"]) if mask}
            assert agent in arrived
            known[agent] |= {sender: truth[sender] for sender in arrived}
            expected = np.concatenate([known[agent][sender] for sender in agents])
            assert np.array_equal(observed[agent], expected.astype(np.float32))


def test_perfect_links_show_everything(drift):
    for observed, infos, truth in beside(drift):
        everything = np.concatenate(list(truth.values()))
        for agent in truth:
            assert np.array_equal(observed[agent], everything) and not infos[agent]["ages"].any()
    env = LossyLinks(drift())
    parallel_api_test(env, num_cycles=20)
    assert env.reset(seed=1)[1]["left"]["time"] == 0, "infos of the environment stay"


def test_links_are_found_by_seed_and_episode(drift):
    env = LossyLinks(drift(), p=0.5)
    masks = {}
    for seed, options in [(1, None), (None, None), (1, {"episode": 1}), (1, {"episode": 0}), (2, None)]:
        env.reset(seed=seed, options=options)
        played = []
        while env.agents:
            *_, infos = env.step({"left": 1, "right": [0.0]})
            played.append(infos["left"]["mask"][1])
        masks[seed, str(options)] = played
    first, following, addressed, again, other = masks.values()
    assert first == again and following == addressed and len({str(mask) for mask in masks.values()}) == 3


def test_velocity_moves_what_the_environment_says(drift):
    place = lambda agent: {"unit": "m", "about": agent, "axis": "x", "rate": (1, 1)}
    speed = lambda agent: {"unit": "m/s", "about": agent, "axis": "x"}
    said = {"left": [place(0), speed(0)], "right": [place(1), speed(1), None]}

    def telling():
        env = drift()
        env.metadata = {**env.metadata, "values": said, "dt": 0.1}
        return env

    for imputer in ("velocity", "kalman"):
        for step, (observed, _, truth) in enumerate(beside(telling, p=0, imputer=imputer)):
            if not step:
                start, speed_of = truth["left"]
            assert observed["right"][0] == pytest.approx(start + 0.1 * step * speed_of, abs=1e-6)
            assert observed["right"][1] == speed_of
        with pytest.raises(ValueError, match=f"{imputer} must know .* drift does not say"):
            LossyLinks(drift(), imputer=imputer)
    for wrong, words in [
        ({**place(0), "rate": (7, 1)}, "value 7 of what left observes is a rate of change, and there are 2 values"),
        (speed(2), "left observes a value about agent 2, and the team has 2"),
    ]:
        said["left"][0] = wrong
        with pytest.raises(ValueError, match=words):
            LossyLinks(telling(), imputer="velocity")
    said["left"].pop()
    with pytest.raises(AgentError, match=r"left: metadata\['values'\] has 1 values for it, but it sends 2"):
        LossyLinks(telling(), imputer="velocity")


@pytest.mark.parametrize("module", MPE, ids=lambda module: module.__name__.split(".")[-1])
def test_velocity_knows_mpe(module):
    """What was seen a step ago, moved on by its velocity, is where it is: bodies move before they are pushed."""
    plain = module.parallel_env()
    receiver, *others = plain.possible_agents
    moving = {
        agent: [at for at, value in enumerate(said) if value and "rate" in value] for agent, said in of(plain).items()
    }
    assert any(moving.values())
    for observed, _, truth in beside(module.parallel_env, links="delay(1)", imputer="velocity"):
        begin = len(truth[receiver])
        for sender in others:
            part = observed[receiver][begin:][: len(truth[sender])]
            assert np.allclose(part[moving[sender]], truth[sender][moving[sender]], atol=1e-5), sender
            begin += len(part)


def test_agents_share_what_a_function_says(drift):
    share = lambda agent, observation: observation[:1] * 2
    env = LossyLinks(drift(), p=0, imputer="zero", share=share)
    assert [env.observation_space(agent).shape for agent in env.possible_agents] == [(3,), (4,)]
    for step, (observed, _, truth) in enumerate(beside(drift, p=0, imputer="zero", share=share)):
        other = 2 * truth["right"][0] if step == 0 else 0.0
        assert np.array_equal(observed["left"], np.append(truth["left"], np.float32(other)))
        assert np.array_equal(observed["right"][1:], truth["right"])
    parallel_api_test(env, num_cycles=20)


def test_own_observations_can_stay_as_they_are(drift):
    env = LossyLinks(drift(), p=0, joint=False)
    assert env.observation_space("left") == drift().observation_space("left")
    for step, (observed, infos, truth) in enumerate(beside(drift, p=0, joint=False)):
        assert all(np.array_equal(observed[agent], truth[agent]) for agent in truth)
        assert np.array_equal(infos["right"]["ages"], [step, 0])
        assert np.array_equal(infos["right"]["estimate"][2:], truth["right"])


def test_a_callable_imputes_for_anybody(drift):
    seen = []

    def guess(agent, estimate, ages):
        seen.append((agent, ages.tolist()))
        return estimate - 1

    for step, (observed, _, truth) in enumerate(beside(drift, steps=3, p=0, imputer=guess)):
        if step == 0:
            start = truth["right"]
        assert np.allclose(observed["left"], np.append(truth["left"], start - step))
    assert seen[-2:] == [("left", [0, 2]), ("right", [2, 0])]


class Odd:
    """What an environment may do wrong at its second step."""

    def __init__(self, drift, change):
        self.make, self.change = drift, change

    def play(self):
        env, change = self.make(), self.change
        links = LossyLinks(env, p=0.5)
        links.reset(seed=0)
        observe = env.observe
        env.observe = lambda: change(observe())
        links.step({"left": 1, "right": [0.0]})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda seen: {**seen, "right": np.array([np.nan, 0, 0])}, "right: observes .*NaN.* must be numbers"),
        (
            lambda seen: {**seen, "left": np.array([1e12, 0])},
            r"left: observes \[1000000000000.0, 0.0\]; values must be numbers",
        ),
        (lambda seen: {**seen, "right": np.zeros(4)}, r"right: observes ndarray of the shape \(4,\)"),
        (lambda seen: {**seen, "right": {"a": 1}}, "right: observes dict"),
        (lambda seen: {"left": seen["left"]}, "right: has left"),
        (lambda seen: {**seen, "third": np.zeros(2)}, "third: has come"),
        (lambda seen: {"left": seen["left"], "third": np.zeros(2)}, "right: has left"),
    ],
)
def test_what_an_environment_does_wrong_names_the_agent(drift, change, words):
    with pytest.raises(AgentError, match=words):
        Odd(drift, change).play()


def test_environments_without_vectors_are_refused(drift):
    for space in (
        spaces.Dict({"a": spaces.Discrete(2)}),
        spaces.Box(0, 255, (8, 8, 3), np.uint8),
        spaces.Discrete(3),
        spaces.Box(-1, 1, ()),
    ):
        env = drift()
        env._sees["right"] = space
        with pytest.raises(AgentError, match="right: observes .* links carry vectors; flatten it first"):
            LossyLinks(env)
    for wrong, words in [
        (dict(env=parallel_to_aec(drift())), "is not a PettingZoo ParallelEnv"),
        (dict(env=drift(), imputer="maro"), "no imputer 'maro' here"),
        (dict(env=drift(), share="all"), "share is"),
        (dict(env=drift(), p=1.5), "level"),
        (dict(env=drift(), links="nothing"), "nothing"),
        (dict(env=drift(), links="delay 20ms"), "needs the length of a tick"),
    ]:
        with pytest.raises(ValueError, match=words):
            LossyLinks(**wrong)
    with pytest.raises(ValueError, match="no places"):
        LossyLinks(drift(), links="range(1.5)").reset(seed=0)
    with pytest.raises(AgentError, match=r"left: shares the shape \(\)"):
        LossyLinks(drift(), share=lambda agent, observation: 1.0)
    with pytest.raises(AgentError, match="left: what it shares .* ZeroDivisionError"):
        LossyLinks(drift(), share=lambda agent, observation: 1 / 0)
