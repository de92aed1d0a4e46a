"""How robust frozen policies are to links that fail."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _native
from .errors import Error
from .fitted import FittedImputer
from .hearing import Guess
from .links import LossyLinks, Share
from .players import Players, RandomTeam, play
from .tasks import parallel_env

if TYPE_CHECKING:
    import pandas

#: Episodes of evaluations are numbered from here on, as in `vamaro-swarm evaluate`: no training meets their draws.
_FIRST_EPISODE = 1 << 49

_LEVELS = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)


class Evaluation:
    """What was played, and its statistics. docs/metrics.md defines the numbers."""

    def __init__(self, native: _native.Evaluation) -> None:
        self._native = native

    def table(self) -> str:
        """The table that `vamaro-swarm evaluate` prints."""
        return self._native.text()

    def to_pandas(self, *, episodes: bool = False) -> pandas.DataFrame:
        """A row for each condition and imputer, or for each of their episodes: `summary.csv` and `episodes.csv`."""
        import pandas

        return pandas.read_csv(io.StringIO(self._native.csv(episodes)))

    def report(self, folder: str | PathLike[str], *, paper: bool = False) -> Path:
        """Writes `report.html`, figures, JSON and CSV into a folder, with `paper` also PDFs. Returns the page."""
        self._native.write(fspath(folder), paper)
        return Path(folder) / "report.html"

    def marl_eval(self) -> dict[str, Any]:
        """The returns as InstaDeep's marl-eval reads them."""
        return json.loads(self._native.marl_eval())

    def results(self) -> dict[str, Any]:
        """Everything, as in `results.json`."""
        return json.loads(self._native.results())

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
    """Plays frozen policies at every level of delivery and over every text of `links`, with every imputer.

    `env_fn` makes a PettingZoo ParallelEnv, or is the name of one of our tasks. `policies` is a team, or a list of teams
    that count as seeds of one method. A team is a policy file of ours, a callable `policy(agent, observation)`, or a
    dict of callables `policy(observation)` by agent. If a callable has `begin(seed, episode)`, that is called before
    each episode. `imputers` are names, or callables and fitted ones by name.

    All cells start from the same seeds, with the same draws of the links, so imputers are compared on equal terms.
    """
    teams = list(policies) if isinstance(policies, (list, tuple)) else [policies]
    if not teams or episodes < 1:
        raise ValueError("there is nothing to play: give a team, and 1 or more episodes")
    conditions = [*("p=" + repr(float(level)).removesuffix(".0") for level in levels), *links]
    if not conditions:
        raise ValueError("there is nothing to play: give levels or links")
    if isinstance(env_fn, str) and imputers is None and all(isinstance(team, (str, PathLike)) for team in teams):
        return _of_files(env_fn, teams, conditions, None, episodes, seed, baseline, share_at_start, greedy)
    known = dict(imputers) if isinstance(imputers, Mapping) else {name: name for name in imputers or ("hold", "zero")}
    if isinstance(env_fn, str) and all(
        isinstance(one, (str, PathLike)) for one in [*teams, *known.values()]
    ):
        names = [str(one) for one in known.values()]
        return _of_files(env_fn, teams, conditions, names, episodes, seed, baseline, share_at_start, greedy)
    if baseline is not None and baseline not in known:
        raise ValueError(f"the baseline {baseline} is none of the imputers {', '.join(known)}")

    def make(condition: str, imputer: Any) -> Any:
        p, text = (float(condition[2:]), None) if condition.startswith("p=") else (1.0, condition)
        if isinstance(env_fn, str):
            return parallel_env(env_fn, p=p, links=text, imputer=imputer, share_at_start=share_at_start)
        return LossyLinks(
            env_fn(), p, text, imputer, joint=joint, share=share, share_at_start=share_at_start
        )

    task = env_fn if isinstance(env_fn, str) else None
    players = [Players(team, task, greedy) for team in teams]
    cells: list[tuple[int, str, str, list[float]]] = []
    for condition in conditions:
        # Where everything is delivered, all imputers have the same outcome.
        lossless = condition == "p=1"
        for name, imputer in known.items():
            if lossless and cells and cells[-1][1] == condition:
                cells += [(team, condition, name, cells[team - len(players)][3]) for team in range(len(players))]
                continue
            env = make(condition, "hold" if lossless else imputer)
            with closing(env):
                for team, played in enumerate(players):
                    cells.append((team, condition, name, _returns(env, played, episodes, seed, max_steps)))
    env = make("p=1", "hold")
    with closing(env):
        random = _returns(env, RandomTeam(env), episodes, seed, max_steps)
        environment, agents = str(env.metadata.get("name", "environment")), len(env.possible_agents)
    native = _native.Evaluation.of_returns(
        environment=environment,
        agents=agents,
        teams=[played.name or f"team-{number}" for number, played in enumerate(players)],
        seed=seed,
        share_at_start=share_at_start,
        random=random,
        cells=cells,
        baseline=baseline or ("hold" if "hold" in known else next(iter(known))),
        call=f"vamaro_swarm.evaluate({environment!r}, episodes={episodes}, seed={seed})",
    )
    return Evaluation(native)


def _of_files(
    task: str,
    teams: Sequence[Any],
    conditions: list[str],
    imputers: list[str] | None,
    episodes: int,
    seed: int,
    baseline: str | None,
    share_at_start: bool,
    greedy: bool,
) -> Evaluation:
    """Everything is ours, and nothing of it plays in Python."""
    levels = [condition[2:] for condition in conditions if condition.startswith("p=")]
    words = [*map(fspath, teams), "--task", task, "--levels", ",".join(levels), "--episodes", str(episodes)]
    words += ["--seed", str(seed), "--in-process"]
    for condition in conditions:
        words += [] if condition.startswith("p=") else ["--links", condition]
    words += [] if imputers is None else ["--imputers", ",".join(imputers)]
    words += [] if baseline is None else ["--baseline", baseline]
    words += ["--greedy"] if greedy else []
    words += [] if share_at_start else ["--no-comm-at-t0"]
    call = f"vamaro_swarm.evaluate({task!r}, {[fspath(team) for team in teams]}, episodes={episodes}, seed={seed})"
    return Evaluation(_native.Evaluation.of_policies(words, call))


def _returns(env: Any, team: Any, episodes: int, seed: int, max_steps: int) -> list[float]:
    """The sums of all that a team earns in each episode."""
    of_team = getattr(env, "team_reward", None) or (lambda rewards: sum(rewards.values()))
    returns = []
    for episode in range(_FIRST_EPISODE, _FIRST_EPISODE + episodes):
        rewards = [rewards for rewards in play(env, team, seed, episode, max_steps) if rewards]
        returns.append(float(sum(map(of_team, rewards))))
        if not np.isfinite(returns[-1]):
            raise Error(f"the return of an episode is {returns[-1]}")
    return returns
