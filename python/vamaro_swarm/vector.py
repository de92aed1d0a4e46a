"""Our tasks, many worlds at once."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ._native import Arena
from .errors import AgentError, Error
from .tasks import action_space, address, box


class VectorEnv:
    """Many worlds of a task, side by side: like a ParallelEnv, but every array has a first axis of `num_envs`.

    Worlds play consecutive episodes, and end together.
    """

    def __init__(self, arena: Arena, num_envs: int) -> None:
        self.metadata = {"name": arena.name, "render_modes": []}
        self.num_envs = num_envs
        self.possible_agents = arena.agents
        self.agents: list[str] = []
        self._arena = arena
        self._actions = dict(zip(self.possible_agents, map(action_space, arena.actions)))
        self._width = max(1, *(len(low) for _, low, _ in arena.actions))
        self._address: tuple[int, int] | None = None

    def observation_space(self, agent: str) -> spaces.Box:
        """The space of joint observations of the team, a row for each world."""
        return box(self.num_envs, self._arena.joint)

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The space of an agent's actions in one world."""
        return self._actions[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, dict[str, Any]]]:
        """Begins episodes from 0 or `options["episode"]` on of this seed; without a seed, the next ones."""
        last = self._address
        if last is not None:
            last = last[0], last[1] + self.num_envs - 1
        self._address = address(last, seed, options)
        estimates, ages, mask = self._room()
        self._arena.begin(*self._address, estimates, ages, mask)
        self.agents = self.possible_agents[:]
        return dict(zip(self.agents, estimates)), self._infos(mask, ages)

    def step(
        self, actions: dict[str, NDArray[Any]]
    ) -> tuple[
        dict[str, NDArray[np.float32]],
        dict[str, NDArray[np.float64]],
        dict[str, NDArray[np.bool_]],
        dict[str, NDArray[np.bool_]],
        dict[str, dict[str, Any]],
    ]:
        """One step in all worlds, given an array of actions for each agent: `[num_envs]`, or `[num_envs, values]`."""
        agents = self.agents
        if not agents:
            raise Error("no episode is under way; call reset() first")
        words = self._words(actions)
        estimates, ages, mask = self._room()
        rewards = np.empty((self.num_envs, len(agents)))
        goes_on = self._arena.step(words, estimates, ages, mask, rewards)
        if not goes_on:
            self.agents = []
        ends = np.zeros(self.num_envs, np.bool_)
        return (
            dict(zip(agents, estimates)),
            dict(zip(agents, rewards.T)),
            dict.fromkeys(agents, ends),
            dict.fromkeys(agents, ends | (not goes_on)),
            self._infos(mask, ages),
        )

    def close(self) -> None:
        """There is nothing to close."""

    def _room(self) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.uint8]]:
        n, worlds = len(self.possible_agents), self.num_envs
        return (
            np.empty((n, worlds, self._arena.joint), np.float32),
            np.empty((n, worlds, n), np.int32),
            np.empty((n, worlds, n), np.uint8),
        )

    def _infos(self, mask: NDArray[np.uint8], ages: NDArray[np.int32]) -> dict[str, dict[str, Any]]:
        rows = zip(self.possible_agents, mask.view(np.bool_), ages)
        return {agent: {"mask": mask, "ages": ages} for agent, mask, ages in rows}

    def _words(self, actions: dict[str, NDArray[Any]]) -> NDArray[np.uint32]:
        """Actions as the arena takes them: numbers, or the bits of values."""
        words = np.zeros((len(self.possible_agents), self.num_envs, self._width), np.uint32)
        for agent, row in zip(self.possible_agents, words):
            if agent not in actions:
                raise AgentError(agent, "no actions are given for it")
            given, space = np.asarray(actions[agent]), self._actions[agent]
            wanted = (self.num_envs, *(space.shape or ()))
            discrete = isinstance(space, spaces.Discrete)
            if given.shape != wanted or (discrete and given.dtype.kind not in "iu"):
                found = f"{given.dtype} of the shape {given.shape}"
                kind = "whole numbers" if discrete else "numbers"
                raise AgentError(agent, f"its actions are {found} instead of {kind} of the shape {wanted}")
            if isinstance(space, spaces.Discrete):
                row[:, 0] = np.where((given >= 0) & (given < space.n), given, np.iinfo(np.uint32).max)
            else:
                row[:] = given.astype(np.float32).view(np.uint32)
        return words
