"""Our tasks as PettingZoo environments."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from ._native import Arena
from .errors import AgentError, Error
from .hearing import Guess, Hearing, links_of
from .picture import picture

if TYPE_CHECKING:
    from .vector import VectorEnv


@overload
def parallel_env(
    task: str,
    *,
    p: float = ...,
    links: str | None = ...,
    imputer: str | Guess | None = ...,
    policy: str | None = ...,
    share_at_start: bool = ...,
    relay: bool = ...,
    render_mode: str | None = ...,
    num_envs: None = ...,
) -> TaskEnv: ...
@overload
def parallel_env(
    task: str,
    *,
    p: float = ...,
    links: str | None = ...,
    imputer: str | Guess | None = ...,
    policy: str | None = ...,
    share_at_start: bool = ...,
    relay: bool = ...,
    render_mode: str | None = ...,
    num_envs: int,
) -> VectorEnv: ...
def parallel_env(
    task: str,
    *,
    p: float = 1.0,
    links: str | None = None,
    imputer: str | Guess | None = "hold",
    policy: str | None = None,
    share_at_start: bool = True,
    relay: bool = False,
    render_mode: str | None = None,
    num_envs: int | None = None,
) -> TaskEnv | VectorEnv:
    """One of our tasks, such as `spread-xy-4`, whose agents observe their joint estimates after links and imputer.

    Links deliver with probability `p`, and then as `links` says, such as `"gilbert(0.1, 0.3) + delay(1)"`. `imputer` is
    a name or a callable. Imputers that need a policy take it from `policy`, a file or `"builtin"`; `imputer=None` is the
    default for that policy. With `relay`, agents also send the newest that they have received of others. With `num_envs`
    the result is a `VectorEnv`, whose arrays have that many rows.
    """
    if callable(imputer) and num_envs is not None:
        raise ValueError("a callable imputer is for one world; leave out num_envs")
    arena = Arena.of_task(
        task,
        links=links_of(p, links),
        imputer="hold" if callable(imputer) else imputer,
        policy=policy,
        worlds=1 if num_envs is None else num_envs,
        share_at_start=share_at_start,
        relay=relay,
    )
    if num_envs is None:
        return TaskEnv(arena, imputer, render_mode)
    from .vector import VectorEnv

    return VectorEnv(arena, num_envs)


class TaskEnv(ParallelEnv[str, NDArray[np.float32], Any]):
    """A task, one world at a time."""

    metadata: dict[str, Any]

    def __init__(self, arena: Arena, imputer: object, render_mode: str | None) -> None:
        self.metadata = {
            "name": arena.name,
            "dt": arena.dt,
            "render_modes": ["rgb_array"],
            "render_fps": 10,
            "is_parallelizable": True,
        }
        self.render_mode = render_mode
        self.possible_agents = arena.agents
        self.agents: list[str] = []
        self._arena = arena
        self._hearing = Hearing(arena, self.possible_agents, imputer)
        self._actions = dict(zip(self.possible_agents, map(action_space, arena.actions)))
        self._sees = {agent: box(arena.joint) for agent in self.possible_agents}
        self._address: tuple[int, int] | None = None

    def observation_space(self, agent: str) -> spaces.Box:
        """The space of joint observations of the team."""
        return self._sees[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The space of an agent's actions."""
        return self._actions[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, dict[str, Any]]]:
        """Begins episode 0 of this seed, or `options["episode"]`; without a seed, the next episode of the last seed."""
        self._address = address(self._address, seed, options)
        heard = self._hearing.begin(*self._address)
        self.agents = self.possible_agents[:]
        return dict(zip(self.agents, heard.estimates)), heard.infos(self.agents)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, NDArray[np.float32]],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """One step of all agents. Episodes never terminate; they are truncated after a fixed number of steps."""
        agents = self.agents
        if not agents:
            raise Error("no episode is under way; call reset() first")
        try:
            chosen = [actions[agent] for agent in agents]
        except KeyError as missing:
            raise AgentError(missing.args[0], "no action is given for it") from None
        rewards = np.empty(len(agents))
        heard, goes_on = self._hearing.step(chosen, rewards)
        if not goes_on:
            self.agents = []
        return (
            dict(zip(agents, heard.estimates)),
            dict(zip(agents, rewards.tolist())),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, not goes_on),
            heard.infos(agents),
        )

    def team_reward(self, rewards: dict[str, float]) -> float:
        """The team's reward, given those of its agents. Its sum over an episode is the return."""
        return self._arena.team_reward([rewards[agent] for agent in self.possible_agents])

    def state(self) -> NDArray[np.float32]:
        """Where agents, landmarks and targets are, and how fast agents move."""
        agents, landmarks, velocities, _ = self._arena.state(0)
        return np.array([*agents, *landmarks, *velocities], np.float32).ravel()

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the world, if `render_mode` is `rgb_array`."""
        if self.render_mode is None:
            return None
        if self.render_mode != "rgb_array":
            raise ValueError(f"render_mode is `rgb_array` or None, not {self.render_mode!r}")
        agents, landmarks, _, goal = self._arena.state(0)
        return picture(agents, landmarks, goal)

    def close(self) -> None:
        """There is nothing to close."""


def address(last: tuple[int, int] | None, seed: int | None, options: dict[str, Any] | None) -> tuple[int, int]:
    """Seed and number of the episode that a reset begins."""
    episode = (options or {}).get("episode")
    if seed is None:
        seed, following = (0, 0) if last is None else (last[0], last[1] + 1)
    else:
        following = 0
    return int(seed), following if episode is None else int(episode)


@lru_cache
def box(*shape: int) -> spaces.Box:
    """The space of estimates, which have no bounds."""
    return spaces.Box(-np.inf, np.inf, shape, np.float32)


def action_space(actions: tuple[int, list[float], list[float]]) -> spaces.Space[Any]:
    """The space of an agent's actions."""
    n, low, high = actions
    if n:
        return spaces.Discrete(n)
    return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)
