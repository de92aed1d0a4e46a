"""Imputers fitted to a frozen team that was trained anywhere."""

from collections.abc import Callable
from contextlib import closing
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from ._native import Lessons
from .fitted import FittedImputer
from .links import LossyLinks, Share
from .players import Players, play

#: Rounds in which the team plays with the predictor trained so far. Before them it plays with perfect links.
_ROUNDS = 8

#: Learning rates at the first update and after the last.
_RATES = 2e-3, 1e-4


def fit_imputer(
    env_fn: Callable[[], Any],
    policies: Any,
    *,
    steps: int = 100_000,
    updates: int = 4_000,
    out: str | PathLike[str] = "imputer.safetensors",
    seed: int = 0,
    joint: bool = True,
    share: str | Share = "obs",
    max_steps: int = 10_000,
) -> FittedImputer:
    """Fits a predictor to the play of a frozen team, and writes it to the file `out`.

    The team plays about `steps` steps: a quarter with everything delivered, the rest over links whose probability of
    delivery is drawn for each episode, on the estimates of the predictor trained so far. So the predictor, an LSTM,
    learns to correct its own errors. `policies` is a team as for `evaluate`.
    """
    path = Path(fspath(out))
    if steps < 1 or updates < 1:
        raise ValueError("there is nothing to learn from: give 1 or more steps and updates")
    options: dict[str, Any] = {"joint": joint, "share": share}
    with closing(LossyLinks(env_fn(), **options)) as links:
        team = Players(policies, env=links)
        first, episode = _record(links, team, seed, 0, steps // 4 or 1, max_steps)
        lessons = Lessons(links.name, links.observers, held=_constants(first), seed=seed)
    recorded = first
    for number in range(_ROUNDS + 1):
        for truth, seen in recorded:
            lessons.keep(len(truth), truth, seen)
        rates = [_RATES[0] + (_RATES[1] - _RATES[0]) * at / (_ROUNDS + 1) for at in (number, number + 1)]
        lessons.learn(-(-updates // (_ROUNDS + 1)), *rates)
        lessons.save(path)
        if number < _ROUNDS:
            with closing(LossyLinks(env_fn(), links="uniform", imputer=FittedImputer(path), **options)) as links:
                recorded, episode = _record(links, team, seed, episode, steps * 3 // (4 * _ROUNDS) or 1, max_steps)
    return FittedImputer(path)


def _record(
    links: LossyLinks, team: Players, seed: int, episode: int, steps: int, max_steps: int
) -> tuple[list[tuple[Any, Any]], int]:
    """Plays at least `steps` steps in whole episodes: their true and seen observations, and the next episode number."""
    recorded = []
    while steps > 0:
        truths, seen = [], []
        for _ in play(links, team, seed, episode, max_steps):
            truths.append(links.sent)
            seen.append(links.padded(links.estimates))
        recorded.append((np.array(truths, np.float32), np.array(seen, np.float32)))
        steps -= len(truths) - 1
        episode += 1
    return recorded, episode


def _constants(recorded: list[tuple[Any, Any]]) -> list[int]:
    """The values that never change."""
    changes = [np.any(truth != truth[:1], axis=0) for truth, _ in recorded]
    return np.flatnonzero(~np.any(changes, axis=0)).tolist()
