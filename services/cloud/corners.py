"""Fits upright faces to the moments of readings, for many objects at once. Pure.

Two faces meet in a corner: from right to left readings are of the right one first. A face's form is what its inverse
depth is of a direction, see `surfaces`.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[Any]
Indices = NDArray[np.intp]

TURNS: Final = 10
SPLITS: Final = 10
"""Number of angles and corner positions tried."""

POLISH: Final = 0.14
"""Radians by which found faces are turned at most when refitted to their readings."""

POLISHED: Final = 9
_TINY: Final = 1e-9
_FLAT: Final = 1e-7


def shares_of(products: Numbers) -> Numbers:
    """Return each reading's contribution to the moments of SPLITS runs of readings: (n, m, 5 * SPLITS)."""
    objects, count, moments = products.shape
    places = np.arange(count)
    run = np.searchsorted(np.arange(1, SPLITS + 1) * count // SPLITS, places, side="right")
    shares = np.zeros((objects, count, moments, SPLITS), np.float32)
    shares[:, places, :, run] = products.transpose(1, 0, 2)
    return shares.reshape(objects, count, -1)


def moments_of_runs(weights: Numbers, shares: Numbers) -> Numbers:
    """Return the moments (5, h * n, SPLITS) of the runs of readings of n objects with (h, n, m) weights."""
    count = len(shares)
    sums = weights.transpose(1, 0, 2) @ shares
    return sums.reshape(count, -1, 5, SPLITS).transpose(2, 1, 0, 3).reshape(5, -1, SPLITS)


def pair_of(sums: Numbers) -> Numbers:
    """Return the best fitting angle, scale of the right face and scale of the left one (n, 3)."""
    right = sums[:, :, :-1].cumsum(axis=2)
    left = np.ascontiguousarray(sums[:, :, :0:-1].cumsum(axis=2)[:, :, ::-1])  # exactly 0 where nothing has weight
    angle = (-np.pi / 2 * (np.arange(TURNS) + 0.5) / TURNS).astype(np.float32)
    (best, *_), split = _search(right, left, angle[:, None, None])
    row = np.arange(len(best))
    right, left = (side[:, row, split, None] for side in (right, left))
    fine = best + np.linspace(-0.5, 0.5, 5, dtype=np.float32)[:, None] * np.float32(np.pi / 2 / TURNS)
    return _search(right, left, np.clip(fine, np.float32(-np.pi / 2), np.float32(0))[:, :, None])[0].T


def single_of(moments: Numbers) -> Numbers:
    """Return the result of `pair_of` for the single face that fits best; there is no right one."""
    xx, xy, yy, xw, yw = moments
    det = xx * yy - xy * xy
    flat = det <= _FLAT * xx * xx
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.where(flat, xw / np.maximum(xx, _TINY), (yy * xw - xy * yw) / det)
        b = np.where(flat, 0, (xx * yw - xy * xw) / det)
    return np.stack([np.arctan2(b, a), np.full(len(a), np.nan), np.hypot(a, b)], axis=1)


def forms_of(pair: Numbers, kappa: Numbers) -> Numbers:
    """Return the forms (n, 3, 3) of pairs of upright faces (n, 3) and of horizontal ones with inverse heights (n,)."""
    angle, right, left = pair.T
    c, s = np.cos(angle), np.sin(angle)
    forms = np.zeros((len(pair), 3, 3), np.float32)
    forms[:, 0, 0], forms[:, 0, 1] = left * c, left * s
    forms[:, 1, 0], forms[:, 1, 1] = -right * s, right * c
    forms[:, 2, 2] = kappa
    return forms


def refined(forms: Numbers, left: Numbers, right: Numbers) -> Numbers:
    """Return the forms (n, 3, 3) that best fit the moments (5, n) of the readings of each upright face."""
    start = np.arctan2(forms[:, 0, 1], forms[:, 0, 0])
    angles = start + np.linspace(-POLISH, POLISH, POLISHED, dtype=np.float32)[:, None]
    c, s = np.cos(angles), np.sin(angles)
    left_k, gain = _fitted(left, c, s)
    right_k, gain_right = _fitted(right, -s, c)
    paired = np.isfinite(forms[:, 1, 0])
    gain = gain + np.where(paired, gain_right, 0)
    best = np.where(np.isfinite(gain), gain, -1).argmax(axis=0)
    rows = np.arange(len(forms))
    left_k, right_k = left_k[best, rows], right_k[best, rows]
    made = forms_of(np.stack([angles[best, rows], right_k, left_k], axis=1), forms[:, 2, 2])
    sound = (left_k > 0) & ((right_k > 0) | ~paired)
    made[~paired, 1] = np.nan
    return np.where(sound[:, None, None], made, forms)


def _search(right: Numbers, left: Numbers, angle: Numbers) -> tuple[Numbers, Indices]:
    """Return the best fitting angles with the scales of both faces, (3, n), and their split (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    left_k, gain = _fitted(left, c, s)
    right_k, gain_right = _fitted(right, -s, c)
    gain = np.where((left_k > 0) & (right_k > 0), gain + gain_right, -1)
    _, rows, splits = gain.shape
    turn, split = np.divmod(gain.transpose(1, 0, 2).reshape(rows, -1).argmax(axis=1), splits)
    row = np.arange(rows)
    found = np.broadcast_to(angle, gain.shape)[turn, row, split]
    return np.stack([found, right_k[turn, row, split], left_k[turn, row, split]]), split


def _fitted(moments: Numbers, c: Numbers, s: Numbers) -> tuple[Numbers, Numbers]:
    """Return scale and gain of faces whose normals are (c, s)."""
    xx, xy, yy, xw, yw = moments
    above = c * xw + s * yw
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = above / (c * c * xx + 2 * c * s * xy + s * s * yy)
    return scale, above * scale
