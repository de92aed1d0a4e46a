"""How robust frozen policies are to links that fail."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from math import isfinite
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _native, values
from .errors import Error
from .fitted import FittedImputer
from .hearing import Guess
from .links import LossyLinks, Share
from .players import Players, RandomTeam, play
from .tasks import parallel_env

if TYPE_CHECKING:
    import pandas

#: The first episode of evaluations, as in `vamaro-swarm evaluate`: no training uses the same draws.
_FIRST_EPISODE = 1 << 49

_LEVELS = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)


class Evaluation:
    """The episodes of an evaluation and their statistics. docs/metrics.md defines the numbers."""

    def __init__(self, native: _native.Evaluation) -> None:
        self._native = native

    def table(self) -> str:
        """The table that `vamaro-swarm evaluate` prints."""
        return self._native.text()

    def to_pandas(self, *, episodes: bool = False) -> pandas.DataFrame:
        """A row for each condition and imputer (`summary.csv`), or each episode (`episodes.csv`)."""
        import pandas

        return pandas.read_csv(io.StringIO(self._native.csv(episodes)))

    def report(self, folder: str | PathLike[str], *, paper: bool = False) -> Path:
        """Writes `report.html`, figures, JSON and CSV, and with `paper` PDFs, to a folder. Returns the page."""
        self._native.write(fspath(folder), paper)
        return Path(folder) / "report.html"

    def marl_eval(self) -> dict[str, Any]:
        """The returns as InstaDeep's marl-eval reads them."""
        read: dict[str, Any] = json.loads(self._native.marl_eval())
        return read

    def results(self) -> dict[str, Any]:
        """Everything, as in `results.json`."""
        read: dict[str, Any] = json.loads(self._native.results())
        return read

    def __str__(self) -> str:
        return self.table()


def evaluate(
    env_fn: str | Callable[[], Any],
    policies: Any,
    *,
    imputers: Mapping[str, str | Guess | FittedImputer] | Iterable[str] | None = None,
    levels: Iterable[float] = _LEVELS,
    links: Iterable[str] = (),
    episodes: int = 100,
    seed: int = 0,
    baseline: str | None = None,
    joint: bool = True,
    share: str | Share = "obs",
    share_at_start: bool = True,
    greedy: bool = False,
    max_steps: int = 10_000,
) -> Evaluation:
    """Plays frozen policies at every level of delivery and over each of `links`, with every imputer.

    `env_fn` makes a PettingZoo ParallelEnv, or is the name of one of our tasks. `policies` is a team, or a list of teams
    that count as seeds of one method. A team is a policy file, a callable `policy(agent, observation)`, or a
    dict of callables `policy(observation)` by agent. If a callable has a method `begin(seed, episode)`, it is
    called before each episode. `imputers` is a list of names, or a dict from labels to names, callables and fitted
    imputers.

    All cells start from the same seeds, with the same draws of the links, so imputers are compared on equal terms.
    """
    teams = list(policies) if isinstance(policies, (list, tuple)) else [policies]
    conditions = [*("p=" + repr(float(level)).removesuffix(".0") for level in levels), *links]
    if not teams or not conditions or episodes < 1:
        raise ValueError("there is nothing to play: give a team, levels or links, and 1 or more episodes")
    named = imputers if imputers is None or isinstance(imputers, Mapping) else {name: name for name in imputers}
    make: Callable[..., Any]
    study = _Study(conditions, episodes, seed, baseline, share_at_start, max_steps)
    if isinstance(env_fn, str):
        # Ours go by their own names.
        ours = all(name == imputer for name, imputer in (named or {}).items())
        if ours and all(isinstance(team, (str, PathLike)) for team in teams):
            return study.of_files(env_fn, [fspath(team) for team in teams], named, greedy)
        make = partial(parallel_env, env_fn, share_at_start=share_at_start)
        players = [Players(team, env_fn, greedy) for team in teams]
    else:
        wrapped: dict[str, Any] = {"joint": joint, "share": share, "share_at_start": share_at_start}
        make = lambda **options: LossyLinks(env_fn(), **options, **wrapped)
        files = any(isinstance(team, (str, PathLike)) for team in teams)
        if files and not (joint and share == "obs"):
            raise ValueError("policy files act on joint estimates of all that agents observe; leave out joint and share")
        env = LossyLinks(env_fn()) if files else None
        players = [Players(team, greedy=greedy, env=env) for team in teams]
        if env is not None:
            env.close()
    return study.of_teams(make, players, dict(named or {"hold": "hold", "zero": "zero"}))


@dataclass(frozen=True)
class _Study:
    """The settings that all teams share."""

    conditions: list[str]
    episodes: int
    seed: int
    baseline: str | None
    share_at_start: bool
    max_steps: int

    def of_files(self, task: str, teams: list[str], imputers: Mapping[str, Any] | None, greedy: bool) -> Evaluation:
        """Teams, task and imputers are ours, so nothing runs in Python."""
        levels = [condition[2:] for condition in self.conditions if condition.startswith("p=")]
        words = [*teams, "--task", task, "--levels", ",".join(levels), "--in-process"]
        words += ["--episodes", str(self.episodes), "--seed", str(self.seed)]
        for condition in self.conditions:
            words += [] if condition.startswith("p=") else ["--links", condition]
        words += [] if imputers is None else ["--imputers", ",".join(map(str, imputers.values()))]
        words += [] if self.baseline is None else ["--baseline", self.baseline]
        words += ["--greedy"] if greedy else []
        words += [] if self.share_at_start else ["--no-comm-at-t0"]
        return Evaluation(_native.Evaluation.of_policies(words, self._call(task)))

    def of_teams(self, make: Callable[..., Any], players: list[Players], imputers: dict[str, Any]) -> Evaluation:
        """The teams play in Python, in the environments that `make` makes."""
        if self.baseline is not None and self.baseline not in imputers:
            raise ValueError(f"the baseline {self.baseline} is none of the imputers {', '.join(imputers)}")
        with closing(make(p=1.0)) as env:
            environment = str(env.metadata.get("name", "environment"))
            agents, tick = len(env.possible_agents), values.step(env)
            _native.Evaluation.check(self.conditions, agents, tick)
            random = self._returns(env, RandomTeam(env))
        cells = [
            (team, condition, name, returns)
            for condition in self.conditions
            for name, played in self._played(make, players, imputers, condition)
            for team, returns in enumerate(played)
        ]
        native = _native.Evaluation.of_returns(
            environment=environment,
            agents=agents,
            tick=tick,
            teams=[played.name or f"team-{number}" for number, played in enumerate(players)],
            seed=self.seed,
            share_at_start=self.share_at_start,
            random=random,
            cells=cells,
            baseline=self.baseline or ("hold" if "hold" in imputers else next(iter(imputers))),
            call=self._call(environment),
        )
        return Evaluation(native)

    def _played(
        self, make: Callable[..., Any], players: list[Players], imputers: dict[str, Any], condition: str
    ) -> Iterator[tuple[str, list[list[float]]]]:
        """The returns of each team with each imputer. If everything is delivered, all imputers have the same."""
        level = float(condition[2:]) if condition.startswith("p=") else 1.0
        text = None if condition.startswith("p=") else condition
        played: list[list[float]] = []
        for name, imputer in imputers.items():
            if not played or condition != "p=1":
                with closing(make(p=level, links=text, imputer=imputer)) as env:
                    played = [self._returns(env, team) for team in players]
            yield name, played

    def _returns(self, env: Any, team: Any) -> list[float]:
        """The return of each episode."""
        of_team = getattr(env, "team_reward", None) or (lambda rewards: sum(rewards.values()))
        returns = []
        for episode in range(_FIRST_EPISODE, _FIRST_EPISODE + self.episodes):
            steps = [rewards for rewards in play(env, team, self.seed, episode, self.max_steps) if rewards]
            returns.append(float(sum(map(of_team, steps))))
            if not isfinite(returns[-1]):
                raise Error(f"the return of an episode is {returns[-1]}")
        return returns

    def _call(self, environment: str) -> str:
        return f"vamaro_swarm.evaluate({environment!r}, episodes={self.episodes}, seed={self.seed})"
