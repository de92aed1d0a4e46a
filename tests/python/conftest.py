"""An environment that is not MPE, and what goes wrong in it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from pettingzoo import ParallelEnv


class Drift(ParallelEnv[str, Any, Any]):
    """Two bodies that drift along a line. Both observe their place and velocity; the second also the time."""

    metadata: dict[str, Any] = {"name": "drift", "render_modes": []}

    def __init__(self, steps: int = 6) -> None:
        self.possible_agents = ["left", "right"]
        self.agents: list[str] = []
        self._steps = steps
        self._sees = {"left": spaces.Box(-9, 9, (2,)), "right": spaces.Box(-9, 9, (3,))}
        self._acts = {"left": spaces.Discrete(3), "right": spaces.Box(-1, 1, (1,))}

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self._sees[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        return self._acts[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.agents = self.possible_agents[:]
        self._time = 0
        rng = np.random.default_rng(seed)
        self.places, self.velocities = rng.uniform(-1, 1, 2), rng.uniform(-1, 1, 2)
        return self.observe(), {agent: {"time": 0} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        push = np.array([actions["left"] - 1, np.ravel(actions["right"])[0]])
        self.velocities = self.velocities + 0.1 * push
        self.places = self.places + 0.1 * self.velocities
        self._time += 1
        over = self._time >= self._steps
        agents, observations = self.agents, self.observe()
        rewards = {agent: -abs(float(place)) for agent, place in zip(agents, self.places)}
        self.agents = [] if over else agents
        ends = dict.fromkeys(agents, over)
        return observations, rewards, dict.fromkeys(agents, False), ends, {agent: {} for agent in agents}

    def observe(self) -> dict[str, Any]:
        """What both observe."""
        (a, b), (v, w) = self.places, self.velocities
        return {"left": np.array([a, v], np.float32), "right": np.array([b, w, self._time], np.float32)}


@pytest.fixture
def drift() -> Callable[[], Drift]:
    return Drift
