"""Binary masks to COCO run-length encoding, which counts down the columns of the whole image. Pure."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Mask

_SHIFTS: Final = np.arange(0, 35, 5)
"""Where the groups of five bits begin in a number of at most 35."""


def encode_window(columns: NDArray[np.bool_], top: int, left: int, height: int, width: int) -> Mask:
    """Encode a mask that is zero outside a window, without ever making the rest of it.

    columns: the window's columns, each from the top down: window width x window height. top, left: where the window
    begins in the image of height x width.
    """
    runs = _merged(_edges(columns, top, left, height))
    counts = np.diff(runs.ravel(), prepend=0, append=height * width)
    if len(counts) > 1 and counts[-1] == 0:
        counts = counts[:-1]
    return Mask((height, width), _compressed(counts))


def _edges(columns: NDArray[np.bool_], top: int, left: int, height: int) -> NDArray[np.int64]:
    """Return where runs of ones begin and end in the image, n x 2; none goes on into the next column."""
    wide, high = columns.shape
    padded = np.zeros(wide * (high + 1) + 1, np.bool_)
    padded[:-1].reshape(wide, high + 1)[:, 1:] = columns
    places = np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)  # each the window's place before a change
    across, down = np.divmod(places, high + 1)
    return (left + across) * height + top + down


def _merged(runs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Join runs that follow on each other without a gap."""
    apart = runs[1:, 0] != runs[:-1, 1]
    begins = np.concatenate([[True], apart])[: len(runs)]
    ends = np.concatenate([apart, [True]])[-len(runs) :] if len(runs) else begins
    return np.stack([runs[begins, 0], runs[ends, 1]], axis=1)


def _compressed(counts: NDArray[np.int64]) -> str:
    """Write counts as COCO does: from the fourth on as differences to the last but one, in groups of five bits."""
    numbers = counts.copy()
    numbers[3:] -= counts[1:-2]
    groups = numbers[:, None] >> _SHIFTS
    low = groups & 0x1F
    rest = groups >> 5
    more = rest != np.where(low & 0x10, -1, 0)
    written = np.ones_like(more)
    np.logical_and.accumulate(more[:, :-1], axis=1, out=written[:, 1:])
    letters = (low | (more << 5)) + ord("0")
    return str(letters[written].astype(np.uint8).tobytes(), "ascii")
