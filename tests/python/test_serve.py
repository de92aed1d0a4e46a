"""Environments in a process of their own, and swarms that play in them."""

import json
import os
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from mpe2 import simple_speaker_listener_v4, simple_spread_v3
from vamaro_swarm import evaluate, evaluation, fit_imputer

ROOT = Path(__file__).parents[2]
HOLD = f"{sys.executable} {ROOT}/agents/python/hold.py"
SERVE = f"{sys.executable} -m vamaro_swarm.serve"

TEAM = """
import numpy as np

def policy(agent, estimate):
    return int(1000 * np.abs(estimate).sum()) % (3 if agent.startswith("speaker") else 5)

def middle(agent, estimate):
    return np.argmax([0.0, -1.0, 1.0]) if agent == "left" else np.clip(-estimate[2:3], -1, 1)
"""


def start(folder, *words):
    """A swarm that runs in a folder, with the package that runs this test."""
    command = [sys.executable, "-P", "-m", "vamaro_swarm", "spawn", *words, "--json"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder)


def finish(swarm):
    out, error = swarm.communicate(timeout=120)
    assert swarm.returncode == 0, error
    return json.loads(out)


@pytest.fixture
def team(tmp_path, monkeypatch):
    """The folder of a team that acts by what it believes, which `evaluate` plays from the same episode on."""
    (tmp_path / "team.py").write_text(TEAM)
    monkeypatch.setattr(evaluation, "_FIRST_EPISODE", 0)
    names = {}
    exec(TEAM, names)
    return tmp_path, names


def plays_as_evaluate_does(team, make, env, policy, links, agents, fitted=None):
    folder, names = team
    imputers = {"hold": fitted or "hold"}
    played = evaluate(make, names[policy], imputers=imputers, levels=(), links=[links], episodes=2, seed=3)
    words = [f"team:{policy}", *([str(fitted.path)] if fitted else [])]
    others = [word for agent in range(agents) for word in ("--agent", " ".join([f"{agent}={HOLD}", *words]))]
    words = ["--env", f"{SERVE} {env}", "--links", links, "--episodes", "2", "--seed", "3"]
    summary = finish(start(folder, *words, *others, "--imputer", "hold", "--audit"))
    returns = played.to_pandas(episodes=True)
    expected = returns[returns["imputer"] == "hold"]["return"].mean()
    assert summary["return_mean"] == pytest.approx(expected, rel=1e-12)
    assert summary["policy"] == "none" and env in summary["environment"]


@pytest.mark.skipif(find_spec("iceoryx2") is None, reason="agents in Python need the package iceoryx2")
@pytest.mark.parametrize(
    "make, agents", [(simple_spread_v3.parallel_env, 3), (simple_speaker_listener_v4.parallel_env, 2)]
)
def test_a_swarm_plays_as_evaluate_does(team, make, agents):
    env = make().metadata["name"]
    links = "level(0.5) + gilbert(0.1, 0.3) + delay(1)"
    plays_as_evaluate_does(team, make, f"mpe2.{env}", "policy", links, agents)


@pytest.mark.skipif(find_spec("iceoryx2") is None, reason="agents in Python need the package iceoryx2")
def test_agents_in_python_impute_by_what_was_fitted(team):
    make, policy = simple_speaker_listener_v4.parallel_env, team[1]["policy"]
    fitted = fit_imputer(make, policy, steps=300, updates=30, out=team[0] / "imputer.safetensors")
    env = f"mpe2.{make().metadata['name']}"
    plays_as_evaluate_does(team, make, env, "policy", "level(0.4) + delay(1)", 2, fitted)


@pytest.mark.skipif(find_spec("iceoryx2") is None, reason="agents in Python need the package iceoryx2")
def test_actions_may_be_values_and_episodes_may_end_early(team, drift, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
    plays_as_evaluate_does(team, drift, "conftest:Drift", "middle", "level(0.5)", 2)


def test_a_policy_that_is_no_callable_plays_as_evaluate_says(team):
    make = simple_speaker_listener_v4.parallel_env
    played = evaluate(make, "untrained", imputers=["hold"], levels=(0.5,), episodes=2)
    words = ["--env", f"{SERVE} mpe2.{make().metadata['name']}", "--policy", "untrained", "--in-process"]
    summary = finish(start(team[0], *words, "--imputer", "hold", "--p", "0.5", "--episodes", "2"))
    assert summary["return_mean"] == pytest.approx(played.to_pandas()["mean"].item(), rel=1e-12)
    with pytest.raises(ValueError, match="joint estimates"):
        evaluate(make, "untrained", joint=False)


def test_worlds_play_side_by_side(tmp_path):
    words = ["--env", f"{SERVE} mpe2.simple_spread_v3 N=2", "--policy", "untrained", "--in-process", "--episodes", "3"]
    one, all_at_once = (start(tmp_path, *words, "--p", "0.5", "--worlds", worlds) for worlds in "13")
    one, all_at_once = finish(one), finish(all_at_once)
    assert one["return_mean"] == pytest.approx(all_at_once["return_mean"], rel=1e-12)
    assert one["delivery_rate"] == all_at_once["delivery_rate"]
    assert (one["ticks"], all_at_once["ticks"]) == (75, 25)


BAD = """
import os, time
import numpy as np
from gymnasium import spaces
from conftest import Drift

class Bad(Drift):
    def __init__(self, fault):
        super().__init__()
        self.fault = fault
        self._acts["right"] = spaces.Discrete(3)
        if fault == "dict":
            self._sees["right"] = spaces.Dict({"a": spaces.Discrete(2)})
        if fault == "endless":
            self._acts["left"] = spaces.Box(-np.inf, np.inf, (1,))

    def step(self, actions):
        seen, rewards, ends, cuts, infos = super().step(actions)
        if self.fault == "nan":
            seen["right"][1] = np.nan
        if self.fault == "shape":
            seen["right"] = seen["right"][:2]
        if self.fault == "reward":
            rewards["left"] = float("inf")
        if self.fault == "leaves":
            self.agents = ["left"]
        if self.fault == "raises":
            raise RuntimeError("out of paper")
        if self.fault == "dies":
            os._exit(7)
        if self.fault == "hangs":
            time.sleep(100)
        return seen, rewards, ends, cuts, infos
"""

FAULTS = {
    "dict": "right: observes Dict",
    "endless": "left: acts by Box(-inf, inf",
    "nan": "right: observes [",
    "shape": "right: observes ndarray of the shape (2,)",
    "reward": "left: gets the reward inf",
    "leaves": "right: has left",
    "raises": "RuntimeError: out of paper",
    "dies": "ended with exit code 7",
    "hangs": "did not take a step within 2s",
}


def tags_until_all_end(place, swarms):
    """The tags of swarms, and of their lines to environments, seen while they run."""
    tags, deadline = set(), time.monotonic() + 120
    while any(swarm.poll() is None for swarm in swarms) and time.monotonic() < deadline:
        tags |= {path.name for path in place.iterdir()} if place.exists() else set()
        time.sleep(0.02)
    return tags


def test_what_an_environment_does_wrong_is_said_of_it(tmp_path, monkeypatch):
    (tmp_path / "bad.py").write_text(BAD)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
    # Short, since sockets have short names.
    with tempfile.TemporaryDirectory(prefix="vs") as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        swarms = {}
        for fault in FAULTS:
            words = ["--env", f"{SERVE} bad:Bad fault={fault}", "--policy", "untrained", "--episodes", "1"]
            words += ["--deadline", "2s"] if fault == "hangs" else ["--in-process"]
            swarms[fault] = start(tmp_path, *words)
        tags = tags_until_all_end(Path(folder, "vamaro-swarm"), swarms.values())
        for fault, says in FAULTS.items():
            _, error = swarms[fault].communicate(timeout=120)
            last = error.strip().splitlines()[-1]
            assert swarms[fault].returncode == 1 and says in last, error
            assert last.startswith("error: the environment (") and f"bad:Bad fault={fault})" in last, error
        assert not list(Path(folder, "vamaro-swarm").iterdir())
    # Each has a line to its environment; the one with processes has a swarm, too.
    assert len(tags) >= len(FAULTS), tags
    assert not [name for name in os.listdir("/dev/shm") if name.startswith(tuple(f"vs_{tag}" for tag in tags))]


def test_commands_that_make_no_sense(tmp_path):
    for words, says in [
        ("mpe2.simple_spread_v3", "only for"),
        ("nowhere.at_all", "No module named 'nowhere'"),
        ("mpe2.simple_spread_v3 3", "expected arguments such as N=4"),
    ]:
        swarm = start(tmp_path, "--env", f"{SERVE} {words}")
        _, error = swarm.communicate(timeout=120)
        assert swarm.returncode in (1, 2) and says in error.strip().splitlines()[-1], error
        assert says != "expected arguments such as N=4" or "Traceback" not in error, error
