"""Joint estimates: what agents know after links and imputer."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._native import Arena
from .errors import AgentError

#: An imputer as a callable: `imputer(agent, estimate, ages)` returns a joint estimate. In the estimate that it gets,
#: values not received are its own guess of the step before, or zero at the first step. `ages` says how many steps ago
#: each sender's part was observed, -1 if never. Values received at this step are kept, whatever the callable returns.
#: If it has a method `begin(seed, episode)`, it is called when an episode begins.
Guess = Callable[[Any, NDArray[np.float32], NDArray[np.int32]], Any]


class Heard(NamedTuple):
    """What agents know at a step."""

    #: Joint estimates, `[agents, joint]`.
    estimates: NDArray[np.float32]
    #: How many steps ago each sender's part was observed, -1 if never, `[agents, agents]`.
    ages: NDArray[np.int32]
    #: What arrived at this step, `[agents, agents]`.
    mask: NDArray[np.bool_]

    def infos(self, agents: Sequence[Any]) -> dict[Any, dict[str, Any]]:
        """Masks and ages, by agent."""
        rows = zip(agents, self.mask, self.ages)
        return {agent: {"mask": mask, "ages": ages} for agent, mask, ages in rows}


class Hearing:
    """Links and imputer of one world."""

    def __init__(self, arena: Arena, agents: Sequence[Any], imputer: object) -> None:
        self.arena = arena
        self._agents = agents
        self._guess: Guess | None = imputer if callable(imputer) else None
        parts, common = arena.parts
        self._parts = np.array([*parts, common])
        self._shape = (len(agents), arena.joint)

    def begin(self, seed: int, episode: int) -> Heard:
        """Begins an episode."""
        heard, mask = self._room()
        self.arena.begin(seed, episode, heard.estimates, heard.ages, mask)
        if self._guess is not None:
            begin = getattr(self._guess, "begin", None)
            if begin is not None:
                begin(seed, episode)
            self._impute(heard)
        return heard

    def step(self, actions: list[Any] | None, rewards: NDArray[np.float64] | None = None) -> tuple[Heard, bool]:
        """One step; also whether the episode goes on."""
        heard, mask = self._room()
        goes_on = self.arena.step(actions, heard.estimates, heard.ages, mask, rewards)
        if self._guess is not None:
            self._impute(heard)
        return heard, goes_on

    def _room(self) -> tuple[Heard, NDArray[np.uint8]]:
        """New arrays, because agents keep those of earlier steps."""
        n = self._shape[0]
        mask = np.empty((n, n), np.uint8)
        ages = np.empty((n, n), np.int32)
        return Heard(np.empty(self._shape, np.float32), ages, mask.view(np.bool_)), mask

    def _impute(self, heard: Heard) -> None:
        """Calls the imputer, and stores its estimates in the arena."""
        assert self._guess is not None
        for agent, estimate, ages in zip(self._agents, heard.estimates, heard.ages):
            try:
                guess = np.asarray(self._guess(agent, estimate.copy(), ages.copy()), np.float32)
            except Exception as error:
                raise AgentError(agent, f"its imputer raised {error!r}") from error
            if guess.shape != estimate.shape:
                words = f"its imputer returned the shape {guess.shape} instead of {estimate.shape}"
                raise AgentError(agent, words)
            if not np.isfinite(guess).all():
                raise AgentError(agent, "its imputer returned values that are not finite")
            # The values that are the same for all agents come after the parts, and are always known.
            known = np.repeat(np.append(ages == 0, True), self._parts)
            np.copyto(estimate, guess, where=~known)
        self.arena.believe(heard.estimates)


def links_of(p: float, links: str | None) -> str:
    """A chain of `level(p)` and these links."""
    if links is None:
        return f"level({p})"
    return links if p == 1 else f"level({p}) + {links}"
