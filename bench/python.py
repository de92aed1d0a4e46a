"""How fast environments are from Python: ours beside mpe2's and JaxMARL's (where it is installed), what LossyLinks adds, and
where the time of `evaluate` goes. docs/python.md has the figures.

Times are of the processor. Rounds take turns, and each figure is a median over rounds, so a busy machine slows all alike.
"""

import os
import sys
from functools import partial
from statistics import median
from time import perf_counter, process_time

import numpy as np
from mpe2 import simple_spread_v3
from vamaro_swarm import LossyLinks, evaluate, evaluation, parallel_env

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


def jax_worlds(worlds):
    """Steps of JaxMARL's simple_spread with 3 agents on the processor, s for each world; None if it is not installed."""
    try:
        import jax
        from jaxmarl import make
    except ImportError:
        return None
    env = make("MPE_simple_spread_v3", num_agents=3, num_landmarks=3)
    keys = jax.random.split(jax.random.PRNGKey(0), worlds)
    actions = {agent: jax.numpy.ones(worlds, int) for agent in env.agents}

    # All steps in one compiled loop, which suits it best; episodes begin anew by themselves.
    @partial(jax.jit, static_argnums=1)
    def play(state, steps):
        step = lambda state, _: (jax.vmap(env.step, (0, 0, 0))(keys, state, actions)[1], None)
        return jax.lax.scan(step, state, None, length=steps)[0]

    _, state = jax.jit(jax.vmap(env.reset))(keys)

    def run(steps):
        jax.block_until_ready(play(state, 100))

    return timed(run, 100 * worlds)


def shares_of_evaluate():
    """The seconds that `evaluate` spends in the environment, in the policies, in links and imputers, and on statistics."""
    # By a clock that is cheap to read, since it is read often. A busy machine lengthens all parts alike.
    spent = dict.fromkeys(("environment", "policies", "episodes", "all"), 0.0)

    def clocked(name, call):
        def run(*words, **options):
            begin = perf_counter()
            try:
                return call(*words, **options)
            finally:
                spent[name] += perf_counter() - begin

        return run

    def make():
        env = simple_spread_v3.parallel_env(N=3)
        env.step, env.reset = clocked("environment", env.step), clocked("environment", env.reset)
        return env

    rng = np.random.default_rng(0)
    layers = [rng.normal(size=shape) for shape in ((54, 64), (64, 64), (64, 5))]

    def policy(agent, estimate):
        hidden = np.tanh(np.tanh(estimate @ layers[0]) @ layers[1])
        return int((hidden @ layers[2]).argmax())

    study = evaluation._Study
    study._returns = clocked("episodes", study._returns)
    clocked("all", evaluate)(make, clocked("policies", policy), levels=(0.5, 0.2), episodes=40)
    spent["statistics"] = spent.pop("all") - spent["episodes"]
    spent["links, imputers and checks"] = spent.pop("episodes") - spent["environment"] - spent["policies"]
    return spent


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
    for worlds in (1, WORLDS, 4096):
        if jax := jax_worlds(worlds):
            timers[f"JaxMARL, {worlds} worlds, p = 1"] = jax
    if not any(name.startswith("JaxMARL") for name in timers):
        print("JaxMARL is not installed (pip install jaxmarl), so it is left out")
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
    spent = shares_of_evaluate()
    words = ", ".join(f"{name} {100 * part / sum(spent.values()):.0f} %" for name, part in spent.items())
    print(f"the time of evaluate: {words} (load {os.getloadavg()[0]:.1f})")


if __name__ == "__main__":
    main()
