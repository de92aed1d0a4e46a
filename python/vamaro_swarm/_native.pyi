"""The part of this package that is written in Rust."""

from collections.abc import Sequence
from os import PathLike
from typing import Any, final

from numpy import float32, float64, int32, uint8, uint32
from numpy.typing import NDArray

version: str

def main(arguments: list[str], program: list[str]) -> int:
    """Runs the command line; returns its exit code. Agents are processes of `program`."""

@final
class Arena:
    """Episodes with actions from Python. Results are written into the caller's arrays."""

    name: str
    agents: list[str]
    joint: int
    parts: tuple[list[int], int]
    episode_steps: int
    dt: float
    actions: list[tuple[int, list[float], list[float]]]

    @staticmethod
    def of_task(
        task: str,
        *,
        links: str,
        imputer: str | None,
        policy: str | None,
        worlds: int,
        share_at_start: bool,
        relay: bool = ...,
    ) -> Arena: ...
    @staticmethod
    def elsewhere(
        name: str,
        agents: list[tuple[str, int]],
        *,
        values: str | None,
        dt: float | None,
        links: str,
        imputer: str,
        policy: str | PathLike[str] | None,
        share_at_start: bool,
        relay: bool = ...,
    ) -> Arena: ...
    def team_reward(self, rewards: Sequence[float]) -> float: ...
    def tell(self, observations: NDArray[float32]) -> None: ...
    def begin(
        self,
        seed: int,
        episode: int,
        estimates: NDArray[float32],
        ages: NDArray[int32],
        mask: NDArray[uint8],
    ) -> None: ...
    def step(
        self,
        actions: list[Any] | NDArray[uint32] | None,
        estimates: NDArray[float32],
        ages: NDArray[int32],
        mask: NDArray[uint8],
        rewards: NDArray[float64] | None = None,
    ) -> bool: ...
    def believe(self, estimates: NDArray[float32]) -> None: ...
    def state(self, world: int) -> tuple[list[list[float]], list[list[float]], list[list[float]], int | None]: ...

@final
class Team:
    """The actors of a policy file."""

    task: str
    agents: list[str]

    def __new__(cls, name: str, task: str | None, greedy: bool) -> Team: ...
    @staticmethod
    def elsewhere(name: str, environment: str, agents: list[tuple[tuple[str, int], int]], greedy: bool) -> Team: ...
    def begin(self, seed: int, episode: int, worlds: int) -> None: ...
    def act(self, agent: int, estimates: NDArray[float32]) -> list[int]: ...

@final
class Lessons:
    """A predictor that learns from episodes played in Python."""

    def __new__(cls, name: str, agents: list[tuple[str, int]], *, held: list[int], seed: int) -> Lessons: ...
    def keep(self, observations: int, truth: NDArray[float32], seen: NDArray[float32]) -> None: ...
    def learn(self, steps: int, first: float, last: float) -> float | None: ...
    def save(self, path: str | PathLike[str]) -> None: ...

@final
class Imputer:
    """The predictor in a file, at the work of one agent."""

    def __new__(
        cls,
        path: str | PathLike[str],
        name: str,
        agents: list[tuple[str, int]],
        *,
        agent: int,
        worlds: int,
        oldest: int,
    ) -> Imputer: ...
    def begin(self, worlds: int) -> None: ...
    def fuse(self, ages: NDArray[uint8], observations: NDArray[float32], estimates: NDArray[float32]) -> None: ...
    def predict(self) -> None: ...

@final
class Evaluation:
    """The episodes of an evaluation, and their statistics."""

    @staticmethod
    def of_policies(arguments: list[str], call: str) -> Evaluation: ...
    @staticmethod
    def check(conditions: list[str], agents: int, tick: float | None) -> None: ...
    @staticmethod
    def of_returns(
        *,
        environment: str,
        agents: int,
        tick: float | None,
        teams: list[str],
        seed: int,
        share_at_start: bool,
        random: list[float],
        cells: list[tuple[int, str, str, list[float]]],
        baseline: str,
        call: str,
    ) -> Evaluation: ...
    def text(self) -> str: ...
    def csv(self, episodes: bool) -> str: ...
    def results(self) -> str: ...
    def marl_eval(self) -> str: ...
    def write(self, folder: str | PathLike[str], paper: bool) -> list[PathLike[str]]: ...

@final
class Host:
    """The environment's end of the line to a supervisor, which `told` names."""

    worlds: int

    def __init__(self, told: str) -> None: ...
    def describe(self, description: str) -> None: ...
    def next(self) -> tuple[int, int, int] | tuple[bytes, bytes] | None:
        """A reset (world, seed, episode), a step (which worlds play, words of actions), or None to leave."""
    def answer(self, rewards: NDArray[float64], ends: NDArray[uint8], observations: NDArray[float32]) -> None: ...
