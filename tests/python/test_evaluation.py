"""Evaluations of policies in Python."""

import json
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from mpe2 import simple_reference_v3
from vamaro_swarm import AgentError, Error, evaluate, load_policy


def to_the_middle(agent, estimate):
    """Both stay near where they believe the other to be: the less they know, the less they do."""
    return np.argmax([0.0, -1.0, 1.0]) if agent == "left" else np.clip(-estimate[2:3], -1, 1)


LEVELS = dict(levels=(1, 0.5, 0), episodes=12)


def test_imputers_are_compared_on_equal_terms(drift):
    imputers = {"hold": "hold", "zero": "zero", "mine": lambda agent, estimate, ages: estimate}
    result = evaluate(drift, to_the_middle, imputers=imputers, links=["delay(1)"], **LEVELS)
    rows = result.to_pandas()
    assert list(rows["imputer"].unique()) == ["hold", "zero", "mine"] and len(rows) == 12
    episodes = result.to_pandas(episodes=True)
    returns = episodes.pivot_table(index="episode", columns=["imputer", "condition", "p"], values="return", dropna=True)
    held = [returns[name].to_numpy() for name in ("hold", "mine")]
    assert np.array_equal(*held), "that callable holds, from the same seeds over the same links"
    lossless = rows[rows["p"] == 1]
    assert lossless["mean"].nunique() == 1
    assert "drift" in result.table() and str(result) == result.table()


def test_results_are_those_of_the_program(tmp_path):
    words = ["--levels", "1,0.2", "--episodes", "8", "--imputers", "hold,dynamics", "--seed", "2", "--in-process"]
    command = [sys.executable, "-m", "vamaro_swarm", "evaluate", "builtin", "--task", "hear-see", *words, "--json"]
    printed = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    options = dict(levels=(1, 0.2), episodes=8, seed=2)
    ours = evaluate("hear-see", "builtin", imputers=["hold", "dynamics"], **options)
    assert ours.results()["groups"] == printed["groups"]
    # The same team, played in Python.
    team = load_policy("builtin", "hear-see")
    played = evaluate("hear-see", team, imputers=["hold"], **options).to_pandas(episodes=True)
    native = ours.to_pandas(episodes=True)
    for p in (1, 0.2):
        returns = [
            rows[(rows["imputer"] == "hold") & (rows["p"] == p)]["return"].to_numpy() for rows in (played, native)
        ]
        assert np.allclose(*returns, rtol=1e-12, atol=0), p
    page = played_report(ours, tmp_path / "new" / "report")
    assert "hear-see" in page
    assert ours.marl_eval()["mappo p = 0.2"]["hear-see"]["hold"]["run_1"]["absolute_metrics"]["return"]


def test_conditions_may_be_links_alone_and_imputers_go_by_names_of_their_own():
    options = dict(levels=(), links=["delay 200ms"], episodes=4, baseline="mine")
    for team in ("builtin", load_policy("builtin", "hear-see")):
        rows = evaluate("hear-see", team, imputers={"mine": "hold", "zero": "zero"}, **options).to_pandas()
        assert rows["imputer"].tolist() == ["mine", "zero"] and rows["condition"].nunique() == 1
    ours = evaluate("hear-see", "builtin", imputers=["hold", "zero"], **{**options, "baseline": None}).to_pandas()
    assert ours["mean"].tolist() == pytest.approx(rows["mean"].tolist(), rel=1e-12)


def played_report(result, folder):
    page = result.report(folder)
    assert (folder / "results.json").exists() and (folder / "robustness.svg").exists()
    return page.read_text()


def test_teams_count_as_seeds_and_begin_with_each_episode():
    class Coin:
        def __init__(self, bias):
            self.bias = bias

        def begin(self, seed, episode):
            self.rng = np.random.default_rng((seed, episode))

        def __call__(self, observation):
            return int(self.rng.random() < self.bias) * 5

    teams = []
    for bias in (0.2, 0.8):
        coin = Coin(bias)
        teams.append({"agent_0": coin, "agent_1": coin})
    make = lambda: simple_reference_v3.parallel_env(max_cycles=5)
    results = [evaluate(make, teams, levels=(1, 0), episodes=4, imputers=["hold"]) for _ in range(2)]
    assert results[0].results()["groups"] == results[1].results()["groups"]
    assert results[0].to_pandas()["policies"].tolist() == [2, 2]


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        (lambda agent, seen: 1 / 0, "left: its policy raised ZeroDivisionError"),
        (lambda agent, seen: np.zeros(2), r"left: its policy returned .* \(shape \(2,\)\)"),
        (lambda agent, seen: 7, "left: its policy returned 7"),
        (lambda agent, seen: 1 if agent == "left" else [np.nan], "right: its policy returned"),
        ({"left": lambda seen: 1}, "right: has no policy"),
    ],
)
def test_what_a_policy_does_wrong_names_its_agent(drift, policy, words):
    with pytest.raises(AgentError, match=words):
        evaluate(drift, policy, **LEVELS)


def test_requests_that_make_no_sense_are_refused(drift):
    for options, words in [
        (dict(policies=[]), "nothing to play"),
        (dict(policies=to_the_middle, levels=()), "nothing to play"),
        (dict(policies=to_the_middle, episodes=0), "nothing to play"),
        (dict(policies=3), "a team is"),
        (dict(policies=to_the_middle, baseline="maro"), "none of the imputers hold, zero"),
        (dict(policies=to_the_middle, levels=(2,)), "level"),
    ]:
        with pytest.raises(ValueError, match=words):
            evaluate(drift, **{"episodes": 4, **options})
    with pytest.raises(ValueError, match="no built-in policy for simple_reference"):
        evaluate(simple_reference_v3.parallel_env, "builtin")
    with pytest.raises(AgentError, match="right: acts by Box.*use a callable"):
        evaluate(drift, "untrained")
    # Before anything is played.
    with pytest.raises(ValueError, match="needs the length of a tick"):
        evaluate(drift, lambda agent, seen: 1 / 0, links=["delay 200ms"], **LEVELS)
    with pytest.raises(ValueError, match="nearest is `hold`"):
        evaluate("hear-see", "builtin", imputers=["holt"])
    with pytest.raises(Error, match="still going on after 3 steps"):
        evaluate(drift, to_the_middle, max_steps=3, **LEVELS)


def test_an_interrupt_ends_an_evaluation():
    interrupt = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    interrupt.start()
    with pytest.raises(KeyboardInterrupt):
        evaluate("spread-xy-4", "builtin", episodes=100_000)
    # The next one is not interrupted any more.
    assert "hear-see" in evaluate("hear-see", "builtin", levels=(1, 0), episodes=2).table()


def test_an_interrupt_leaves_the_work_of_other_threads_alone():
    tables = []
    options = dict(imputers=["hold"], levels=(1, 0))
    work = lambda: tables.append(evaluate("hear-see", "builtin", episodes=400, **options).table())
    other = threading.Thread(target=work)
    other.start()
    interrupt = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    interrupt.start()
    with pytest.raises(KeyboardInterrupt):
        evaluate("spread-xy-4", "builtin", episodes=100_000)
    other.join()
    assert "hear-see" in tables[0]
