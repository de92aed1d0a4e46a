"""Imputers that are fitted to a team from elsewhere."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from vamaro_swarm import FittedImputer, LossyLinks, evaluate, fit_imputer

PROGRAM = Path(sys.executable).with_name("vamaro-swarm")


def coasting(agent, estimate):
    """Nobody pushes."""
    return 1 if agent == "left" else np.zeros(1)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    from conftest import Drift

    out = tmp_path_factory.mktemp("fit") / "drift.safetensors"
    return fit_imputer(Drift, coasting, steps=2000, updates=600, out=out)


def errors(env_fn, imputer):
    """How far estimates of the other's place are from the truth where nothing arrives after the start."""
    env, wrong = LossyLinks(env_fn(), p=0, imputer=imputer), []
    for episode in range(1000, 1040):
        env.reset(seed=1, options={"episode": episode})
        while env.agents:
            env.step({agent: coasting(agent, None) for agent in env.agents})
            wrong.append(env.estimates[0][2] - env.sent[1][0])
    return float(np.sqrt(np.mean(np.square(wrong))))


def test_it_learns_how_the_others_move(drift, fitted):
    by_fitted, by_holding = errors(drift, fitted), errors(drift, "hold")
    assert by_fitted < 0.5 * by_holding, (by_fitted, by_holding)


def test_inspect_shows_an_imputer_and_nobody_who_acts(fitted):
    shown = [
        subprocess.run([PROGRAM, "inspect", fitted.path, *more], capture_output=True, text=True, timeout=60, check=True)
        for more in ([], ["--json"])
    ]
    text, held = shown[0].stdout, json.loads(shown[1].stdout)
    assert text.startswith("imputer for drift\n") and held["kind"] == "imputer"
    assert f"parameters  {held['parameters']}\n" in text
    assert (held["actor"], held["sharing"], held["hidden"]) == (None, None, None)
    assert held["tensors"] and not [it for it in held["tensors"] if it["name"].startswith("actors.")]


def test_it_is_an_imputer_like_others(drift, fitted):
    again = FittedImputer(fitted.path)
    result = evaluate(drift, coasting, imputers={"hold": "hold", "fitted": again}, levels=(1, 0), episodes=5)
    assert result.to_pandas()["imputer"].tolist() == ["hold", "hold", "fitted", "fitted"]
    first = LossyLinks(drift(), p=0.3, imputer=fitted)
    second = LossyLinks(drift(), p=0.3, imputer=again)
    for env in (first, second):
        env.reset(seed=5)
        env.step({"left": 1, "right": [0.0]})
        env.step({"left": 1, "right": [0.0]})
    assert np.array_equal(first.estimates, second.estimates)


def test_another_environment_is_refused(fitted):
    from mpe2 import simple_reference_v3

    with pytest.raises(ValueError, match="drift"):
        LossyLinks(simple_reference_v3.parallel_env(), imputer=fitted)
    with pytest.raises(ValueError, match="there is no file nowhere"):
        FittedImputer("nowhere")


def test_the_file_of_an_imputer_says_what_it_is(fitted):
    command = [sys.executable, "-P", "-m", "vamaro_swarm", "inspect", str(fitted.path)]
    told = subprocess.run(command, capture_output=True, text=True, timeout=60).stdout
    assert told.startswith("imputer for drift\n") and "actor       none" in told and "actors.0" not in told, told
