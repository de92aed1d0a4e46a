"""Pictures of a world."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

#: Pixels of each side, and the metres that they show, around the origin.
_PIXELS = 400
_METRES = 3.0

#: Agents by their number (after Okabe and Ito, for all eyes), landmarks, and the landmark that is the goal.
_AGENTS = [(0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (213, 94, 0)]
_LANDMARK = (64, 64, 64)
_GOAL = (0, 0, 0)


def picture(
    agents: Sequence[Sequence[float]], landmarks: Sequence[Sequence[float]], goal: int | None
) -> NDArray[np.uint8]:
    """Landmarks as squares, agents as discs."""
    image = np.full((_PIXELS, _PIXELS, 3), 255, np.uint8)
    centres = (np.arange(_PIXELS) + 0.5) / _PIXELS * _METRES - _METRES / 2
    for number, (x, y) in enumerate(landmarks):
        half, colour = (0.09, _GOAL) if number == goal else (0.05, _LANDMARK)
        rows, columns = np.abs(-centres - y) < half, np.abs(centres - x) < half
        image[np.ix_(rows, columns)] = colour
    for number, (x, y) in enumerate(agents):
        squared = (-centres[:, None] - y) ** 2 + (centres[None, :] - x) ** 2
        image[squared < 0.08**2] = _AGENTS[number % len(_AGENTS)]
    return image
