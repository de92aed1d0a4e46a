"""Teams that play in an environment, in any form a user may give them."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from .errors import AgentError, Error
from .policies import Team

if TYPE_CHECKING:
    from .links import LossyLinks


class Players:
    """A team: a policy file of ours, a callable `policy(agent, observation)`, or callables `policy(observation)` by agent."""

    def __init__(
        self, team: Any, task: str | None = None, greedy: bool = False, env: LossyLinks | None = None
    ) -> None:
        self.name = fspath(team) if isinstance(team, (str, PathLike)) else getattr(team, "name", None)
        if isinstance(team, (str, PathLike)):
            team = Team(fspath(team), task, greedy, env)
        self._each = team if isinstance(team, Mapping) else None
        self._all = team if callable(team) else None
        if self._each is None and self._all is None:
            raise ValueError(f"a team is a policy file, a callable or a dict of callables by agent, not {team!r}")
        parts = self._each.values() if self._each is not None else [team]
        # Agents may share a policy, which begins once.
        different = {id(part): part for part in parts}.values()
        self._begins = [part.begin for part in different if hasattr(part, "begin")]

    def begin(self, seed: int, episode: int) -> None:
        for begin in self._begins:
            begin(seed, episode)

    def act(self, agent: Any, observation: Any) -> Any:
        if self._all is not None:
            return self._all(agent, observation)
        assert self._each is not None
        if agent not in self._each:
            raise AgentError(agent, "has no policy")
        return self._each[agent](observation)


class RandomTeam:
    """A team that chooses uniformly among its actions."""

    def __init__(self, env: Any) -> None:
        self._spaces = {agent: copy.deepcopy(env.action_space(agent)) for agent in env.possible_agents}

    def begin(self, seed: int, episode: int) -> None:
        seeds = np.random.SeedSequence((seed, episode)).generate_state(len(self._spaces))
        for space, number in zip(self._spaces.values(), seeds):
            space.seed(int(number))

    def act(self, agent: Any, observation: Any) -> Any:
        return self._spaces[agent].sample()


def play(env: Any, team: Any, seed: int, episode: int, max_steps: int) -> Iterator[dict[Any, float]]:
    """Plays an episode. Yields an empty dict after the reset, and the rewards after each step."""
    acts = {agent: env.action_space(agent) for agent in env.possible_agents}
    observations, _ = env.reset(seed=seed, options={"episode": episode})
    team.begin(seed, episode)
    yield {}
    for _ in range(max_steps):
        if not env.agents:
            return
        actions = {agent: _action(team, agent, observations[agent], acts[agent]) for agent in env.agents}
        observations, rewards, *_ = env.step(actions)
        yield rewards
    if env.agents:
        raise Error(f"an episode is still going on after {max_steps} steps; end it, or raise max_steps")


def _action(team: Any, agent: Any, observation: Any, space: spaces.Space[Any]) -> Any:
    """An agent's action, checked."""
    try:
        action = team.act(agent, observation)
    except AgentError:
        raise
    except Exception as error:
        raise AgentError(agent, f"its policy raised {error!r}") from error
    if isinstance(space, spaces.Box):
        # Policies compute in other precisions than environments.
        given = np.asarray(action, space.dtype) if np.ndim(action) == len(space.shape) else action
        if space.contains(given):
            return given
    elif space.contains(action):
        return action
    shape = np.shape(action)
    raise AgentError(agent, f"its policy returned {action!r} (shape {shape}), which is not in {space}")
