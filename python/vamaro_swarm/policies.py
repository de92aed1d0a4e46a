"""Policies that are files."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ._native import Team as _Actors
from .errors import AgentError

if TYPE_CHECKING:
    from .links import LossyLinks


class Team:
    """The agents of a policy file, each with its recurrent state.

    `team(agent, estimate)` is the action of one agent, `team.act(observations)` the actions of all, by name. If
    observations have a row for each world, so have actions. Call `begin` at the start of each episode.
    """

    def __init__(self, name: str, task: str | None, greedy: bool, env: LossyLinks | None = None) -> None:
        if env is None:
            self._actors = _Actors(name, task, greedy)
        else:
            choices = [_choices(agent, env.action_space(agent)) for agent in env.possible_agents]
            self._actors = _Actors.elsewhere(name, env.name, list(zip(env.observers, choices)), greedy)
        self._env = env
        #: The name or path it was loaded from.
        self.name = name
        #: The id of its task, or the name of its environment.
        self.task = self._actors.task
        #: The names of its agents.
        self.agents = self._actors.agents
        self._numbers = {agent: number for number, agent in enumerate(self.agents)}
        self._worlds = 0

    def begin(self, seed: int = 0, episode: int = 0, num_envs: int | None = None) -> None:
        """Begins an episode. Seed and episode decide the draws of actions, which are those of `vamaro-swarm spawn`."""
        worlds = 1 if num_envs is None else num_envs
        self._actors.begin(seed, episode, worlds)
        self._worlds, self._batched = worlds, num_envs is not None

    def __call__(self, agent: str, estimate: NDArray[np.float32]) -> Any:
        """The action of an agent, given its joint estimate."""
        if not self._worlds:
            self.begin()
        if agent not in self._numbers:
            raise AgentError(agent, f"is none of {', '.join(self.agents)}, who play {self.task}")
        if self._env is not None:
            estimate = self._env.padded(estimate[None])
        estimate = np.ascontiguousarray(estimate, np.float32)
        try:
            actions = self._actors.act(self._numbers[agent], estimate)
        except ValueError as error:
            raise AgentError(agent, f"cannot act on an estimate of the shape {estimate.shape}: {error}") from None
        return np.array(actions, np.int64) if self._batched else actions[0]

    def act(self, observations: Mapping[str, NDArray[np.float32]]) -> dict[str, Any]:
        """The actions of all agents."""
        return {agent: self(agent, estimate) for agent, estimate in observations.items()}

    def __repr__(self) -> str:
        return f"<team of {self.task} from {self.name}>"


def _choices(agent: Any, space: spaces.Space[Any]) -> int:
    """How many actions an agent has."""
    if isinstance(space, spaces.Discrete) and space.start == 0:
        return int(space.n)
    raise AgentError(agent, f"acts by {space}, but policy files choose among Discrete actions from 0 on; use a callable")


def load_policy(name: str | PathLike[str], task: str | None = None, *, greedy: bool = False) -> Team:
    """Loads the team of a policy file or of a training run's folder, or with `builtin` the built-in one of a `task`.

    It samples its actions, or takes the most probable ones if `greedy`.
    """
    return Team(fspath(name), task, greedy)
