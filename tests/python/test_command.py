"""The program `vamaro-swarm`, and training."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
import vamaro_swarm
from vamaro_swarm import load_policy, train, training

PROGRAM = Path(sys.executable).with_name("vamaro-swarm")


def run(*words):
    return subprocess.run([PROGRAM, *words], capture_output=True, text=True, timeout=120)


def test_the_program_is_there():
    version = run("--version").stdout
    assert version == f"vamaro-swarm {vamaro_swarm.__version__}\n"
    wrong = run("spawn", "--task", "nowhere")
    assert wrong.returncode == 2 and wrong.stderr.startswith("error: there is no task `nowhere`")
    assert run("nonsense").returncode == 2
    twice = (
        "from vamaro_swarm._native import main\nprint([main([what], ['python']) for what in ('tasks', 'doctor')][1])"
    )
    both = subprocess.run([sys.executable, "-c", twice], capture_output=True, text=True, timeout=120)
    assert both.stdout.endswith("\n2\n") and "a process for each" in both.stderr, both.stderr


def test_agents_are_processes_that_leave_nothing_behind():
    played = run("spawn", "--agents", "2", "--episodes", "3")
    assert played.returncode == 0 and "2 agents as processes" in played.stdout, played.stderr
    # Short, since sockets have short names.
    with tempfile.TemporaryDirectory(prefix="vs") as folder:
        place = {**os.environ, "XDG_RUNTIME_DIR": folder}
        words = [PROGRAM, "spawn", "--agents", "2", "--episodes", "1000000"]
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=place) as swarm:
            tags, segments = Path(folder, "vamaro-swarm"), []
            deadline = time.monotonic() + 60
            while len(segments) < 4 and time.monotonic() < deadline:
                time.sleep(0.05)
                found = [path.name for path in tags.iterdir()] if tags.exists() else []
                segments = [
                    name for name in os.listdir("/dev/shm") if name.startswith(tuple(f"vs_{tag}" for tag in found))
                ]
            assert segments
            swarm.send_signal(signal.SIGINT)
            assert swarm.wait(60) == 130
        assert not list(tags.iterdir()) and not [name for name in segments if Path("/dev/shm", name).exists()]


def test_a_team_is_trained_and_played(tmp_path):
    small = dict(hidden=32, predictor_hidden=16, test_episodes=2, replay_batch=8, quiet=True)
    team = train("hear-see", steps=600, out=tmp_path / "run", **small)
    assert team.task == "hear-see" and (tmp_path / "run" / "metrics.csv").exists()
    estimates = {agent: np.zeros(16, np.float32) for agent in team.agents}
    assert all(0 <= action < 5 for action in team.act(estimates).values())
    assert load_policy(tmp_path / "run").act(estimates).keys() == estimates.keys()
    with pytest.raises(ValueError, match="already holds a run"):
        train("hear-see", steps=600, out=tmp_path / "run", **small)
    with pytest.raises(ValueError, match="no setting"):
        train("hear-see", steps=600, out=tmp_path / "other", nonsense=1, quiet=True)


def test_who_interrupts_a_training_hears_it_out(tmp_path, monkeypatch):
    """More than a pipe has room for."""
    program, ended = tmp_path / "program", tmp_path / "ended"
    last_words = f"head -c 300000 /dev/zero >&2; touch {ended}; exit"
    program.write_text(f"#!/bin/sh\ntrap '{last_words}' TERM\necho begun >&2\nwhile :; do sleep 0.05; done\n")
    program.chmod(0o755)

    class Interrupt:
        def write(self, line):
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "executable", str(program))
    monkeypatch.setattr(sys, "stderr", Interrupt())
    with pytest.raises(KeyboardInterrupt):
        training._run(["train"], quiet=False)
    assert ended.exists()
