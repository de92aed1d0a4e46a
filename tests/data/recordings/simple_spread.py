"""Records episodes of PettingZoo's simple_spread_v3, which `vamaro-swarm verify` compares with our own.

    pip install mpe2==1.1.1 && python3 simple_spread.py

Actions are random: moments of hard pushes, so that agents meet.
"""

import json

import numpy as np
from mpe2 import simple_spread_v3

STEPS = 25


def record(n, continuous, seeds):
    env = simple_spread_v3.parallel_env(N=n, local_ratio=0.5, max_cycles=STEPS, continuous_actions=continuous)
    return [episode(env, continuous, seed) for seed in seeds]


def episode(env, continuous, seed):
    observations, _ = env.reset(seed=seed)
    rng, world, names = np.random.default_rng(seed), env.unwrapped.world, list(env.possible_agents)
    places = lambda of: [[float(x) for x in entity.state.p_pos] for entity in of]
    velocities = lambda: [[float(x) for x in agent.state.p_vel] for agent in world.agents]
    seen = lambda observations: [[float(x) for x in observations[name]] for name in names]
    if seed % 2:  # Close together, so that there are contacts from the start.
        for agent in world.agents:
            agent.state.p_pos = agent.state.p_pos * 0.2
        observations = {name: env.unwrapped.observe(name) for name in names}
    recorded = {
        "goal_landmark": None,
        "landmark_pos": places(world.landmarks),
        "agent_pos": [places(world.agents)],
        "agent_vel": [velocities()],
        "actions": [],
        "obs": [seen(observations)],
        "agent_reward": [],
        "team_reward": [],
    }
    for _ in range(STEPS):
        if continuous:
            actions = {name: rng.uniform(0, 1, 5).astype(np.float32) for name in names}
        else:
            actions = {name: int(rng.integers(5)) for name in names}
        observations, rewards, _, _, _ = env.step(actions)
        listed = [actions[name] for name in names]
        recorded["actions"].append([[float(x) for x in action] for action in listed] if continuous else listed)
        recorded["agent_pos"].append(places(world.agents))
        recorded["agent_vel"].append(velocities())
        recorded["obs"].append(seen(observations))
        recorded["agent_reward"].append([float(rewards[name]) for name in names])
        recorded["team_reward"].append(float(sum(rewards[name] for name in names)))
    recorded["return"] = float(sum(recorded["team_reward"]))
    return recorded


for task, n, continuous in [
    ("simple-spread-3", 3, False),
    ("simple-spread-5", 5, False),
    ("simple-spread-continuous-3", 3, True),
]:
    header = {"task": task, "n_agents": n, "n_landmarks": n, "episode_steps": STEPS}
    with open(f"{task}.json", "w") as file:
        json.dump({**header, "episodes": record(n, continuous, range(4))}, file, separators=(",", ":"))
