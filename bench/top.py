"""What it costs a swarm that it can be watched, and that somebody watches. docs/benchmarks.md has the figures.

    python3 bench/top.py PROGRAM [OLDER] [words for `spawn` ..]

Rounds take turns: unwatched, watched by one `top` in a terminal of 100 x 30, and, where an OLDER program without `top` is
given, that one. Ratios are taken round by round, and each figure is a median over rounds.
"""

import json
import os
import pty
import struct
import subprocess
import sys
import termios
import threading
from fcntl import ioctl
from os.path import isfile
from statistics import median

ROUNDS = 9
USUAL = ["--agents", "4", "--p", "0.2", "--episodes", "400"]


def watch(program, process):
    """A `top` in a terminal that is read; how to end it."""
    child, terminal = pty.fork()
    if child == 0:
        os.environ["TERM"] = "xterm-256color"
        os.execv(program, [program, "top", str(process)])
    ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))

    def read():
        try:
            while os.read(terminal, 1 << 16):
                pass
        except OSError:
            pass

    threading.Thread(target=read, daemon=True).start()

    def end():
        os.waitpid(child, 0)
        os.close(terminal)

    return end


def play(program, words, is_watched):
    """The summary of a run. Who watches comes as soon as that is possible, and stays."""
    swarm = subprocess.Popen([program, "spawn", *words, "--json"], stdout=subprocess.PIPE, text=True)
    end = watch(program, swarm.pid) if is_watched and can_be_watched(program, swarm) else None
    summary = json.loads(swarm.communicate()[0])
    if end:
        end()
    return summary


def can_be_watched(program, swarm):
    """Waits until a swarm can be watched, or has ended: without a terminal, `top` finds it and complains of that."""
    while swarm.poll() is None:
        top = [program, "top", str(swarm.pid)]
        found = subprocess.run(top, stdin=subprocess.DEVNULL, capture_output=True, text=True, start_new_session=True)
        if "there is no terminal" in found.stderr:
            return True
    sys.exit("the swarm ended before it could be watched; give more --episodes")


def main():
    program, *rest = sys.argv[1:]
    older = rest.pop(0) if rest and isfile(rest[0]) else None
    words = rest or USUAL
    cases = {"unwatched": (program, False), "watched": (program, True)}
    if older:
        cases["older"] = (older, False)
    found = {case: [] for case in cases}
    for _ in range(ROUNDS):
        for case, (path, is_watched) in cases.items():
            found[case].append(play(path, words, is_watched))
    returns = {summary["return_mean"] for case in found.values() for summary in case}
    print(f"spawn {' '.join(words)}: {ROUNDS} rounds, load {os.getloadavg()[0]:.1f}; {len(returns)} different returns")
    figures = {
        "tick p50, us": lambda summary: summary["tick_p50_us"],
        "tick p99, us": lambda summary: summary["tick_p99_us"],
        "whole tick, us": lambda summary: 1e6 * summary["elapsed_s"] / summary["ticks"],
    }
    for name, figure in figures.items():
        values = {case: [figure(summary) for summary in summaries] for case, summaries in found.items()}
        line = ", ".join(f"{case} {median(values[case]):.1f}" for case in cases)
        over = lambda one, other: median(a / b for a, b in zip(values[one], values[other]))
        ratios = [f"watched / unwatched {over('watched', 'unwatched'):.3f}"]
        if older:
            ratios.append(f"unwatched / older {over('unwatched', 'older'):.3f}")
        print(f"{name:<16} {line}; {', '.join(ratios)}")


if __name__ == "__main__":
    main()
