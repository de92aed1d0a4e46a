"""Links that fail, around any PettingZoo environment whose observations are vectors."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from . import values
from ._native import Arena
from .errors import AgentError, Error
from .fitted import FittedImputer
from .hearing import Guess, Heard, Hearing, links_of
from .tasks import address, box

#: What an agent sends, given its name and its observation: a vector.
Share = Callable[[Any, NDArray[Any]], Any]

_IMPUTERS = ("zero", "hold", "velocity", "kalman")


class LossyLinks(BaseParallelWrapper[Any, Any, Any]):
    """An environment whose agents exchange what they observe over links that fail.

    Each agent observes the joint estimate: the parts of all agents, in the order of `possible_agents`. Its own part is
    exact, the others' are what the links delivered and the imputer filled in. With `joint=False`, agents get the
    environment's own observations, and the joint estimate is in their info. Infos have `mask` (whose part arrived at
    this step) and `ages` (how many steps ago each part was observed, -1 if never).

    Links deliver with probability `p`, and then as `links` says. If `share` is a function, agents send its result
    instead of their observation; an agent's own part is still its full observation. `imputer` is `zero`, `hold`,
    `velocity`, `kalman`, a callable, or what `fit_imputer` returns. With `relay`, agents also send the newest that they
    have received of others.
    """

    def __init__(
        self,
        env: ParallelEnv[Any, Any, Any],
        p: float = 1.0,
        links: str | None = None,
        imputer: str | Guess | FittedImputer = "hold",
        *,
        joint: bool = True,
        share: str | Share = "obs",
        share_at_start: bool = True,
        relay: bool = False,
    ) -> None:
        if not hasattr(env, "possible_agents") or hasattr(env, "agent_iter"):
            raise ValueError(
                f"{env} is not a PettingZoo ParallelEnv with possible_agents; pettingzoo.utils.aec_to_parallel"
                " makes one of an environment whose agents take turns"
            )
        fitted = imputer.path if isinstance(imputer, FittedImputer) else None
        if fitted is None and not callable(imputer) and imputer not in _IMPUTERS:
            words = f"{', '.join(_IMPUTERS)}, callables, and what fit_imputer returns"
            raise ValueError(f"there is no imputer {imputer!r} here, only {words}")
        if share != "obs" and not callable(share):
            raise ValueError(f'share is "obs" or a function of agent and observation, not {share!r}')
        super().__init__(env)
        self._team = list(env.possible_agents)
        self._joint = joint
        self._share = share if callable(share) else None
        self._vectors = {agent: _vector(agent, env.observation_space(agent)) for agent in self._team}
        self._lengths = [self._length(agent) for agent in self._team]
        #: What is played, and how much each agent sends.
        self.name = str(env.metadata.get("name", type(env.unwrapped).__name__))
        self.observers = [(str(agent), length) for agent, length in zip(self._team, self._lengths)]
        named = imputer if isinstance(imputer, str) else "hold"
        arena = Arena.elsewhere(
            self.name,
            self.observers,
            values=self._values(named),
            dt=values.step(env),
            links=links_of(p, links),
            imputer=named if fitted is None else "fitted",
            policy=fitted,
            share_at_start=share_at_start,
            relay=relay,
        )
        self._hearing = Hearing(arena, self._team, imputer)
        self._sent = np.zeros((len(self._team), max(self._lengths)), np.float32)
        rows = [row[:length] for row, length in zip(self._sent, self._lengths)]
        shapes = [(self._vectors[agent],) for agent in self._team]
        self._rows = list(zip(self._team, shapes, rows))
        ends = np.cumsum(self._lengths)
        self._parts = {agent: (end - length, end) for agent, length, end in zip(self._team, self._lengths, ends)}
        self._address: tuple[int, int] | None = None
        self._heard: Heard | None = None

    @property
    def sent(self) -> NDArray[np.float32]:
        """What all agents sent at this step, padded: `[agents, longest]`."""
        return self._sent.copy()

    @property
    def estimates(self) -> NDArray[np.float32]:
        """The joint estimates of all agents at this step, `[agents, joint]`."""
        if self._heard is None:
            raise Error("no episode has begun; call reset() first")
        return self._heard.estimates

    def padded(self, estimates: NDArray[np.float32]) -> NDArray[np.float32]:
        """Joint estimates with each part as long as the longest: `[agents, agents, longest]`."""
        parts = np.zeros((len(estimates), *self._sent.shape), np.float32)
        for part, (begin, end) in enumerate(self._parts.values()):
            parts[:, part, : end - begin] = estimates[:, begin:end]
        return parts

    def observation_space(self, agent: Any) -> spaces.Space[Any]:
        """The space of joint estimates; with `joint=False` the environment's own."""
        if not self._joint:
            return self.env.observation_space(agent)
        length = self._hearing.arena.joint
        if self._share is not None:
            begin, end = self._parts[agent]
            length += self._vectors[agent] - (end - begin)
        return box(int(length))

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[Any, Any], dict[Any, dict[str, Any]]]:
        """Begins an episode, with the links of episode 0 of this seed, or without a seed of the next episode.

        `options={"episode": e}` begins episode e of the seed; the environment's own seed follows from both.
        """
        self._address = address(self._address, seed, options)
        if options is not None and "episode" in options:
            seed = int(np.random.SeedSequence(self._address).generate_state(1)[0])
            options = {key: value for key, value in options.items() if key != "episode"} or None
        observations, infos = self.env.reset(seed=seed, options=options)
        self._tell(observations)
        return self._give(observations, infos, self._hearing.begin(*self._address))

    def step(
        self, actions: dict[Any, Any]
    ) -> tuple[dict[Any, Any], dict[Any, float], dict[Any, bool], dict[Any, bool], dict[Any, dict[str, Any]]]:
        """One step of the environment, after which all agents send what they observe."""
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        self._tell(observations)
        heard, _ = self._hearing.step(None)
        observed, infos = self._give(observations, infos, heard)
        return observed, rewards, terminations, truncations, infos

    def _tell(self, observations: dict[Any, Any]) -> None:
        """Notes what all agents send."""
        if len(observations) > len(self._team):
            extra = next(agent for agent in observations if agent not in self._parts)
            raise AgentError(extra, "has come, but is not one of possible_agents")
        for agent, expected, sent in self._rows:
            if agent not in observations:
                raise AgentError(agent, "has left; all agents must stay until the episode ends")
            observation = observations[agent]
            shape = getattr(observation, "shape", None)
            if shape != expected:
                words = f"observes {type(observation).__name__} of the shape {shape}"
                raise AgentError(agent, f"{words} instead of {expected[0]} values as its space says")
            if self._share is not None:
                observation = self._shared(agent, observation)
                if observation.shape != sent.shape:
                    words = f"shares the shape {observation.shape} instead of {len(sent)} values as before"
                    raise AgentError(agent, words)
            sent[:] = observation
        self._hearing.arena.tell(self._sent)

    def _give(
        self, observations: dict[Any, Any], infos: dict[Any, dict[str, Any]], heard: Heard
    ) -> tuple[dict[Any, Any], dict[Any, dict[str, Any]]]:
        """What each agent observes, and its info."""
        self._heard = heard
        rows = heard.infos(self._team)
        for agent, row in rows.items():
            if info := infos.get(agent):
                rows[agent] = {**info, **row}
        if not self._joint:
            for row, estimate in zip(rows.values(), heard.estimates):
                row["estimate"] = estimate
            return observations, rows
        estimates = zip(self._team, heard.estimates)
        if self._share is None:
            return dict(estimates), rows
        return {agent: self._in_full(agent, row, observations[agent]) for agent, row in estimates}, rows

    def _in_full(self, agent: Any, estimate: NDArray[np.float32], observation: NDArray[Any]) -> NDArray[np.float32]:
        """An estimate in which the agent's own part is its full observation instead of what it shares."""
        begin, end = self._parts[agent]
        return np.concatenate([estimate[:begin], observation, estimate[end:]], dtype=np.float32)

    def _length(self, agent: Any) -> int:
        """How many values an agent sends."""
        if self._share is None:
            return self._vectors[agent]
        sample = self._shared(agent, self.env.observation_space(agent).sample())
        if sample.ndim != 1 or not sample.size:
            raise AgentError(agent, f"shares the shape {sample.shape} instead of a vector")
        return len(sample)

    def _shared(self, agent: Any, observation: Any) -> NDArray[np.float32]:
        assert self._share is not None
        try:
            return np.asarray(self._share(agent, observation), np.float32)
        except Exception as error:
            raise AgentError(agent, f"what it shares raised {error!r}") from error

    def _values(self, imputer: str) -> str | None:
        """What the imputer must know about the values that are sent, as JSON."""
        if imputer not in ("velocity", "kalman"):
            return None
        said = None if self._share is not None else values.of(self.env)
        if said is None or values.step(self.env) is None:
            raise ValueError(
                f"the imputer {imputer} must know which values are positions and velocities and how long a step is, but"
                f" {self.name} does not say; put this into env.metadata['values'] and env.metadata['dt']"
                " (docs/python.md), or use hold"
            )
        return json.dumps([values.complete(agent, said, n) for agent, n in zip(self._team, self._lengths)])


def _vector(agent: Any, space: spaces.Space[Any]) -> int:
    """How long the vectors of a space are."""
    if not isinstance(space, spaces.Box) or len(space.shape) != 1 or not space.shape[0]:
        raise AgentError(agent, f"observes {space}, but links carry vectors; flatten it first")
    return space.shape[0]
