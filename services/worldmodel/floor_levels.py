"""How high the floor is that each camera shows, and which views show it where it is. Pure."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.worldmodel.frames import Frames

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

_LOW_ROWS: Final = np.repeat((0.7, 0.8, 0.9), 8)
_LOW_COLUMNS: Final = np.tile((np.arange(8) + 0.5) / 8, 3)
"""Where in its grid a view is asked for the floor, as shares of the grid's height and width."""

FLOOR_VIEWS: Final = 9
"""Of so many views of a camera the median says how high the floor is: a few that show a pit do not change it."""

DEEPER_M: Final = 0.5
"""Depth this far below the floor is a sensor error."""


def floor_levels(frames: Frames, camera: Floats, rotation: Floats) -> Floats:
    """Return how high above the map's zero is what views show in their lower part, the median (views,) in metres.

    Infinite where depth is missing there. camera, rotation: as in `evidence.look`.
    """
    column = (frames.columns[:, np.newaxis] * _LOW_COLUMNS).astype(np.intp)
    row = (frames.rows[:, np.newaxis] * _LOW_ROWS).astype(np.intp)
    cell = frames.starts[:, np.newaxis] + row * frames.columns[:, np.newaxis] + column
    depth = frames.near_mm[cell] / 1000.0
    fx, fy, cx, cy = (each[:, np.newaxis] for each in frames.lens.T)
    right, down, ahead = (each[:, np.newaxis] for each in rotation[:, 2].T)
    rise = right * (column + 0.5 - cx) / fx + down * (row + 0.5 - cy) / fy + ahead
    return np.asarray(np.median(np.where(depth > 0, camera[:, 2:] + depth * rise, np.inf), axis=1))


class FloorLevels:
    """How high above the map's zero the floor is that each camera shows in its lower part, if its view fits, in metres.

    known: by the camera's number, NaN where it is not known.
    """

    def __init__(self) -> None:
        self.known = np.zeros(0)
        self._last = np.zeros((0, FLOOR_VIEWS))

    def compare(self, cameras: Rows, floor_m: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which views show the floor where it is, and which show it too deep. floor_m: see `floor_levels`.

        It is where the camera showed it, or where most cameras do. Where no camera did, neither is known.
        """
        self._reserve(int(cameras.max(initial=-1)) + 1)
        own, all_known = self.known[cameras], self.known[np.isfinite(self.known)]
        usual = np.median(all_known) if len(all_known) else np.nan
        right = (np.abs(floor_m - own) < DEEPER_M) | (np.abs(floor_m - usual) < DEEPER_M)
        return right, floor_m < np.minimum(np.fmin(own, usual), 0.0) - DEEPER_M

    def learn(self, cameras: Rows, floor_m: Floats) -> None:
        """Learn from views that fit, one of each camera."""
        some = np.isfinite(floor_m)
        if not some.any():
            return
        cameras = cameras[some]
        self._reserve(int(cameras.max()) + 1)
        self._last[cameras] = np.column_stack([self._last[cameras, 1:], floor_m[some]])
        self.known[cameras] = np.nanmedian(self._last[cameras], axis=1)

    def forget(self, cameras: Rows) -> None:
        """Begin anew with cameras."""
        self._last[cameras[cameras < len(self.known)]] = np.nan
        self.known[cameras[cameras < len(self.known)]] = np.nan

    def restore(self, known: Sequence[float]) -> None:
        """Go on with what was known before, where nothing is."""
        self._reserve(len(known))
        self.known[: len(known)] = [each if np.isfinite(each) else np.nan for each in known]
        self._last[:] = self.known[:, np.newaxis]

    def _reserve(self, count: int) -> None:
        if count > len(self.known):
            more = np.full((count - len(self.known), FLOOR_VIEWS), np.nan)
            self.known, self._last = np.concatenate([self.known, more[:, 0]]), np.concatenate([self._last, more])
