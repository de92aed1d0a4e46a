"""Training for our tasks: the command `vamaro-swarm train`."""

import signal
import subprocess
import sys
from os import PathLike, fspath
from pathlib import Path

from .errors import Error
from .policies import Team, load_policy


def train(
    task: str = "hear-see",
    *,
    steps: int = 5_000_000,
    seed: int = 0,
    out: str | PathLike[str] | None = None,
    resume: bool = False,
    processes: bool = False,
    quiet: bool = False,
    **settings: object,
) -> Team:
    """Trains a team, with predictors alongside, and returns it.

    `settings` are those of docs/training.md, such as `learning_rate=3e-4`. The run is kept in `out`, by default
    `runs/TASK-SEED`; an interrupted run continues with `resume=True`. With `processes`, agents collect the experience as
    processes; the result is the same, bit for bit. Progress goes to stderr, unless `quiet`.
    """
    folder = Path(f"runs/{task}-{seed}" if out is None else fspath(out))
    words = ["--task", task, "--steps", str(steps), "--seed", str(seed), "--out", str(folder)]
    words += [] if processes else ["--in-process"]
    words += ["--resume"] if resume else []
    for name, value in settings.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        words += ["--set", f"{name}={text}"]
    _run(["train", *words], quiet)
    return load_policy(folder)


def _run(words: list[str], quiet: bool) -> None:
    """Runs a command, and lets it end in good order if Python is interrupted."""
    command = [sys.executable, "-P", "-m", "vamaro_swarm", *words]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        last = ""
        try:
            for line in process.stderr:
                last = line.strip() or last
                if not quiet:
                    sys.stderr.write(line)
            code = process.wait()
        except BaseException:
            # It keeps what it has learned. A terminal has told it already.
            process.send_signal(signal.SIGTERM)
            try:
                process.communicate(timeout=60)
            except subprocess.TimeoutExpired:
                process.kill()
            raise
    words_of = last.removeprefix("error: ") or f"`vamaro-swarm {words[0]}` ended with code {code}"
    if code == 2:
        raise ValueError(words_of)
    if code == 130:
        raise KeyboardInterrupt(words_of)
    if code:
        raise Error(words_of)
