"""A fitted imputer."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._native import Imputer

if TYPE_CHECKING:
    from numpy import float32, uint8
    from numpy.typing import NDArray

#: Ticks; where agents relay, nothing older arrives.
_OLDEST = 100


class FittedImputer:
    """An imputer that `fit_imputer` wrote to a file, for the environment it was fitted to."""

    def __init__(self, path: str | PathLike[str]) -> None:
        #: The policy file that holds its predictor.
        self.path = Path(fspath(path))
        if not self.path.is_file():
            raise ValueError(f"there is no file {self.path}; fit_imputer writes one")

    def for_agent(self, told: Mapping[str, Any]) -> AgentImputer:
        """The same for one agent of a swarm, in a process of its own: `told` is the JSON object on its command line."""
        return AgentImputer(self.path, told)

    def __repr__(self) -> str:
        return f"FittedImputer({str(self.path)!r})"


class AgentImputer:
    """A fitted imputer at the work of one agent. Call `begin` when an episode begins, then `fuse` and `predict` at each tick."""

    def __init__(self, path: Path, told: Mapping[str, Any]) -> None:
        spec, address, layout = told["settings"]["spec"], told["address"], told["wire"]["layout"]
        agents = [(str(agent["name"]), len(agent["observation"])) for agent in spec["agents"]]
        oldest = _OLDEST if layout["relay"] else address["longest_delay"]
        worlds = address["worlds"]
        self._joint = layout["joint"]
        self._imputer = Imputer(path, spec["id"], agents, agent=told["agent"], worlds=worlds, oldest=oldest)

    def begin(self, worlds: int) -> None:
        """An episode begins in each of so many worlds."""
        self._imputer.begin(worlds)

    def fuse(self, ages: NDArray[uint8], observations: NDArray[float32]) -> NDArray[float32]:
        """The joint estimates, `[worlds, joint]`.

        `observations`, `[worlds, agents, observation]`, are what the agent itself observes and what has just arrived.
        `ages`, `[worlds, agents]`, say how many ticks ago that was observed, 255 if nothing arrived.
        """
        import numpy as np

        estimates = np.empty((len(ages), self._joint), np.float32)
        self._imputer.fuse(ages, observations, estimates)
        return estimates

    def predict(self) -> None:
        """Carries the last estimates over to the next tick. The action should be out by then."""
        self._imputer.predict()
