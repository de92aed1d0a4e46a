"""How fast environments are from Python: ours beside mpe2's, and what LossyLinks adds. docs/python.md has the figures.

Times are of the processor. Rounds take turns, and each figure is a median over rounds, so a busy machine slows all alike.
"""

import sys
from statistics import median
from time import process_time

import numpy as np
from mpe2 import simple_spread_v3
from vamaro_swarm import LossyLinks, parallel_env

ROUNDS, STEPS, WORLDS = 9, 500, 256


def one_world(env):
    """Steps of one world, s each."""
    seed = 0
    env.reset(seed=seed)
    actions = dict.fromkeys(env.possible_agents, 1)

    def run(steps):
        nonlocal seed
        for _ in range(steps):
            if not env.agents:
                seed += 1
                env.reset(seed=seed)
            env.step(actions)

    return timed(run, STEPS)


def many_worlds(env):
    """Steps of all worlds, s for each world."""
    seed = 0
    env.reset(seed=seed)
    actions = {agent: np.ones(env.num_envs, np.int64) for agent in env.possible_agents}

    def run(steps):
        nonlocal seed
        for _ in range(steps // env.num_envs):
            if not env.agents:
                seed += 1
                env.reset(seed=seed)
            env.step(actions)

    return timed(run, STEPS * env.num_envs // 5)


def timed(run, steps):
    run(steps // 10)

    def once():
        begin = process_time()
        run(steps)
        return (process_time() - begin) / steps

    return once


def main():
    mpe = lambda n: simple_spread_v3.parallel_env(N=n, max_cycles=25)
    timers = {
        "mpe2 simple_spread_v3, 3 agents": one_world(mpe(3)),
        "ours simple-spread-3": one_world(parallel_env("simple-spread-3")),
        "ours, p = 0.5": one_world(parallel_env("simple-spread-3", p=0.5)),
        f"ours, {WORLDS} worlds": many_worlds(parallel_env("simple-spread-3", num_envs=WORLDS)),
        f"ours, {WORLDS} worlds, p = 0.5": many_worlds(parallel_env("simple-spread-3", p=0.5, num_envs=WORLDS)),
        "mpe2 simple_spread_v3, 4 agents": one_world(mpe(4)),
        "the same in LossyLinks, p = 0.5": one_world(LossyLinks(mpe(4), p=0.5)),
        "ours simple-spread-4": one_world(parallel_env("simple-spread-4")),
        "the same in LossyLinks, p = 0.5 ": one_world(LossyLinks(parallel_env("simple-spread-4"), p=0.5)),
    }
    seconds = {name: [] for name in timers}
    for _ in range(ROUNDS):
        for name, once in timers.items():
            seconds[name].append(once())
    reference = seconds["mpe2 simple_spread_v3, 3 agents"]
    print(f"{'':34} {'us a step':>10} {'mpe2 is slower by':>18}")
    for name, values in seconds.items():
        ratio = median(a / b for a, b in zip(reference, values))
        of_three = "" if "4" in name.split(",")[0] or "the same" in name else f"{ratio:17.1f}x"
        print(f"{name:34} {1e6 * median(values):10.2f} {of_three:>18}")
    plain, wrapped = seconds["ours simple-spread-4"], seconds["the same in LossyLinks, p = 0.5 "]
    added = 1e6 * median(b - a for a, b in zip(plain, wrapped))
    print(
        f"LossyLinks adds {added:.1f} us a step to 4 agents (python {sys.version.split()[0]}, numpy {np.__version__})"
    )


if __name__ == "__main__":
    main()
