"""Our tasks as PettingZoo environments."""

import json
import subprocess
import sys

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils import parallel_to_aec
from vamaro_swarm import AgentError, Error, load_policy, parallel_env


def lossy(**options):
    return parallel_env("spread-xy-4", p=0.5, links="gilbert(0.1, 0.3) + delay(1)", imputer="hold", **options)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("task", ["hear-see", "speaker-listener", "simple-spread-3", "simple-spread-continuous-2", "predator-prey-3", "scout-3"])
def test_the_api_is_that_of_pettingzoo(task):
    parallel_api_test(parallel_env(task, p=0.5), num_cycles=60)
    parallel_seed_test(lambda: parallel_env(task, p=0.5), num_cycles=60)


def test_links_and_pictures_keep_the_api():
    parallel_api_test(lossy(), num_cycles=60)
    parallel_seed_test(lossy, num_cycles=60)
    render_test(lambda render_mode: parallel_to_aec(lossy(render_mode=render_mode)))
    env = lossy(render_mode="rgb_array")
    env.reset(seed=1)
    picture = env.render()
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) >= 5, "white, landmarks and four agents, some in front"
    assert env.state().shape == (2 * 4 + 2 * 4 + 2 * 4,)


def test_an_episode_is_found_by_its_seed_and_number():
    env = lossy()
    first, _ = env.reset(seed=3)
    second, infos = env.reset()
    addressed, again = env.reset(seed=3, options={"episode": 1})
    assert not np.array_equal(first["agent-0"], second["agent-0"])
    for agent in env.agents:
        assert np.array_equal(second[agent], addressed[agent])
        assert np.array_equal(infos[agent]["ages"], again[agent]["ages"])


def test_agents_have_what_links_and_imputer_left_them():
    perfect, none = parallel_env("spread-xy-4"), parallel_env("spread-xy-4", p=0, imputer="zero")
    truth, _ = perfect.reset(seed=5)
    observed, infos = none.reset(seed=5)
    assert infos["agent-1"]["mask"].all() and np.array_equal(observed["agent-1"], truth["agent-0"])
    for step in range(1, 4):
        actions = dict.fromkeys(perfect.agents, step)
        truth, *_ = perfect.step(actions)
        observed, *_, infos = none.step(actions)
        assert np.array_equal(infos["agent-1"]["mask"], [False, True, False, False])
        assert np.array_equal(infos["agent-1"]["ages"], [step, 0, step, step])
        own, common = observed["agent-1"][4:8], observed["agent-1"][16:]
        assert np.array_equal(own, truth["agent-0"][4:8]) and np.array_equal(common, truth["agent-0"][16:])
        assert not observed["agent-1"][:4].any() and not observed["agent-1"][8:16].any()


def test_masks_are_nested_across_levels():
    envs = [parallel_env("spread-blindfold", p=p) for p in (0.2, 0.5, 0.8)]
    for env in envs:
        env.reset(seed=9)
    arrived = np.zeros(3)
    while envs[0].agents:
        actions = dict.fromkeys(envs[0].agents, 0)
        masks = [np.array([info["mask"] for info in env.step(actions)[-1].values()]) for env in envs]
        assert (masks[0] <= masks[1]).all() and (masks[1] <= masks[2]).all()
        arrived += [mask.sum() - 3 for mask in masks]
    assert 0 < arrived[0] < arrived[1] < arrived[2]


def test_links_may_depend_on_places_and_on_seconds():
    env = parallel_env("spread-xy-4", links="range(1.5, noise_floor=-20) + delay 200ms")
    env.reset(seed=1)
    ages = [info["ages"] for _ in range(8) for info in env.step(dict.fromkeys(env.agents, 1))[-1].values()]
    assert set(np.unique(ages)) >= {0, 2}, "steps last 0.1 s"


def test_worlds_side_by_side_are_those_one_after_the_other():
    batch, single = lossy(num_envs=3), lossy()
    observed, infos = batch.reset(seed=4)
    for _ in range(2):
        first = batch._address[1]
        actions, rows = [], [(observed, infos, None, None)]
        while batch.agents:
            actions.append({agent: np.arange(3) + len(actions) % 3 for agent in batch.agents})
            observed, rewards, _, ends, infos = batch.step(actions[-1])
            rows.append((observed, infos, rewards, ends))
        assert len(rows) == 26
        for world in range(3):
            alone, info = single.reset(seed=4, options={"episode": first + world})
            for step, (observed, infos, rewards, ends) in enumerate(rows):
                if step:
                    chosen = {agent: action[world] for agent, action in actions[step - 1].items()}
                    alone, earned, _, over, info = single.step(chosen)
                    assert all(rewards[agent][world] == earned[agent] for agent in alone)
                    assert all(ends[agent][world] == over[agent] for agent in alone)
                for agent in alone:
                    assert np.array_equal(observed[agent][world], alone[agent])
                    assert np.array_equal(infos[agent]["mask"][world], info[agent]["mask"])
        observed, infos = batch.reset()


def test_a_team_plays_as_the_program_has_it_play():
    """Agents are processes of Python there."""
    words = ["spawn", "--task", "spread-xy-4", "--p", "0.2", "--episodes", "4", "--seed", "3", "--json"]
    output = subprocess.run([sys.executable, "-m", "vamaro_swarm", *words], capture_output=True, check=True)
    spawned = json.loads(output.stdout)
    env = parallel_env("spread-xy-4", p=0.2, imputer="dynamics", policy="builtin")
    team = load_policy("builtin", "spread-xy-4")
    returns = []
    for episode in range(4):
        observed, _ = env.reset(seed=3, options={"episode": episode})
        team.begin(3, episode)
        total = 0.0
        while env.agents:
            observed, rewards, *_ = env.step(team.act(observed))
            total += env.team_reward(rewards)
        returns.append(total)
    assert np.mean(returns) == pytest.approx(spawned["return_mean"], rel=1e-12)


def test_a_batch_of_worlds_is_played_by_one_team():
    env, team = parallel_env("hear-see", p=0, num_envs=50), load_policy("builtin", "hear-see")
    observed, _ = env.reset(seed=1)
    team.begin(1, 0, num_envs=50)
    total = np.zeros(50)
    while env.agents:
        observed, rewards, *_ = env.step(team.act(observed))
        total += sum(rewards.values())
    assert total.shape == (50,) and np.isfinite(total).all() and len(np.unique(total)) == 50


def test_a_callable_imputes_what_did_not_arrive():
    calls = []

    class Guess:
        def begin(self, seed, episode):
            calls.append((seed, episode))

        def __call__(self, agent, estimate, ages):
            return np.where(np.repeat(ages == 0, 4).tolist() + [True] * 6, estimate, estimate + 1)

    env = parallel_env("spread-blindfold", p=0, imputer=Guess())
    start, _ = env.reset(seed=2)
    for step in range(1, 4):
        observed, *_ = env.step(dict.fromkeys(env.agents, 0))
        expected = start["agent-0"][4:12] + step
        assert np.allclose(observed["agent-0"][4:12], expected), "guesses are carried"
    assert calls == [(2, 0)]


@pytest.mark.parametrize(
    ("returned", "words"),
    [(np.zeros(3), "shape (3,)"), (np.full(18, np.nan), "not finite"), ("?", "raised ValueError")],
)
def test_a_callable_that_returns_no_estimate_is_named(returned, words):
    env = parallel_env("spread-blindfold", p=0, imputer=lambda agent, estimate, ages: returned)
    with pytest.raises(AgentError, match="agent-0: its imputer") as raised:
        env.reset(seed=0)
    assert words in str(raised.value) and raised.value.agent == "agent-0"


@pytest.mark.parametrize("action", [5, -1, 1.5, None, "up", np.zeros(2)])
def test_an_action_that_does_not_exist_is_named_by_its_agent(action):
    env = parallel_env("spread-xy-2")
    env.reset(seed=0)
    with pytest.raises(AgentError, match=r"agent-1: its action .* is not a whole number from 0 to 4"):
        env.step({"agent-0": 0, "agent-1": action})
    with pytest.raises(AgentError, match="agent-0: no action"):
        env.step({"agent-1": 0})


@pytest.mark.parametrize("action", [[2.0] * 5, [0.5] * 4, [0.5] * 6, [np.nan] * 5, 3])
def test_values_out_of_bounds_are_named_by_their_agent(action):
    env = parallel_env("simple-spread-continuous-2")
    env.reset(seed=0)
    good = np.full(5, 0.5, np.float32)
    env.step({"agent_0": good, "agent_1": good})
    with pytest.raises(AgentError, match="agent_1: its action .* is not 5 values"):
        env.step({"agent_0": good, "agent_1": action})


def test_batches_of_the_wrong_shape_are_named_by_their_agent():
    env = parallel_env("spread-xy-2", num_envs=3)
    env.reset(seed=0)
    good = np.zeros(3, int)
    for wrong in (np.zeros(2, int), np.zeros(3), np.array([0, 5, 0]), np.array([0, -1, 0])):
        with pytest.raises(AgentError, match="agent-1: its action"):
            env.step({"agent-0": good, "agent-1": wrong})


def test_requests_that_make_no_sense_are_refused():
    for wrong, words in [
        (dict(task="spread-xy-5"), "N even"),
        (dict(task="hear-see", p=2), "level"),
        (dict(task="hear-see", links="gilbert(2)"), "gilbert"),
        (dict(task="hear-see", imputer="holt"), "nearest is `hold`"),
        (dict(task="hear-see", imputer="dynamics"), "no dynamics"),
        (dict(task="hear-see", policy="nowhere"), "there is no policy"),
        (dict(task="hear-see", imputer=lambda *_: 0, num_envs=2), "one world"),
        (dict(task="hear-see", num_envs=0), "num_envs is 0"),
        (dict(task="hear-see", num_envs=10**10), "hear-see can be played in 1 to"),
    ]:
        with pytest.raises(ValueError, match=words):
            parallel_env(**wrong)
    env = parallel_env("hear-see")
    with pytest.raises(Error, match="call reset"):
        env.step({})
    with pytest.raises(AgentError, match="nobody: is none of"):
        load_policy("builtin", "hear-see")("nobody", np.zeros(16))
    for worlds in (0, 10**10):
        with pytest.raises(ValueError, match=f"num_envs is {worlds}"):
            load_policy("builtin", "hear-see").begin(num_envs=worlds)
