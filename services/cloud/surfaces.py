"""Fits the faces of upright boxes to noisy readings of a depth camera, for many objects at once. Pure.

A plane's inverse depth is linear in the direction that a pixel looks in, and there a stereo camera's noise is as large
far away as near. Of a box one sees at most two upright faces that meet in a corner, and its top or its underside. Each
pixel shows the farthest of these planes, the one of the least inverse depth. A ray that leads away from one of them
misses the box.

Directions are (3, ...) along level axes, the third one up, of points at a depth of 1; a form is what a plane's inverse
depth is of a direction: their scalar product.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from services.cloud.corners import forms_of, moments_of_runs, pair_of, refined, shares_of, single_of

Numbers = NDArray[Any]
Indices = NDArray[np.intp]

ROUNDS: Final = 3
LEVELS: Final = (0.35, 0.65, 0.93)
"""Shares of an object's readings that may lie below its top, or above its underside."""

LEAST_HEIGHT_M: Final = 0.02
"""From the camera's own height a horizontal face is not seen."""

COHERENT: Final = 12.0
"""Pixels per independent noise sample: stereo cameras match windows."""

LIKELY: Final = 2.0
"""How much worse than the best another explanation may fit, in squared standard deviations."""

REACH: Final = 3.0
"""Standard deviations that noise explains."""

_TINY: Final = 1e-9
_LEAST_SHARE: Final = 0.04
_NORMAL: Final = 1.25
_LEAST_NOISE: Final = 1e-6
_SEEN: Final = 1e-4
_NEAREST: Final = 20.0
"""Inverse depths between which readings are."""


@dataclass(frozen=True, slots=True, eq=False)
class Faces:
    """Faces of n objects. forms: (n, 3, 3), two upright faces' and the horizontal one's, NaN where there is none.

    along: (n,) angles of the first upright face's normal. noise: (n,) standard deviations of inverse depth.
    """

    forms: Numbers
    along: Numbers
    noise: Numbers

    def inverse_depth(self, directions: Numbers, nearer: Numbers | float = 0.0) -> Numbers:
        """Return the inverse depth of each object in (n, 3, m) directions, (n, m); infinite where there is no face.

        nearer: (n, 3, 1) by how much each face's is taken to be larger.
        """
        return _least(_inverse(self.forms, directions) + nearer)


@dataclass(frozen=True, slots=True, eq=False)
class _Readings:
    """Readings of n objects, right to left: directions x (ahead), y, z; inverse depths w; weights. (n, m) each.

    Readings without weight are copies of others. products: (n, m, 5), the contribution of each to its face's moments.
    """

    x: Numbers
    y: Numbers
    z: Numbers
    w: Numbers
    weights: Numbers
    products: Numbers

    def inverse(self, forms: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """Return the inverse depth of either upright face and of the horizontal one of forms (h, n, 3, 3): (h, n, m).

        NaN where there is none, and below 0 where rays are led away.
        """
        left, right, level = np.moveaxis(forms, 2, 0)[..., np.newaxis]
        first, second = (face[:, :, 0] * self.x + face[:, :, 1] * self.y for face in (left, right))
        return first, second, level[:, :, 2] * self.z

    def trusted(self, off: Numbers, weights: Numbers) -> Numbers:
        """Return weights that fall with a reading's error, in units of the error of the readings with `weights`."""
        return self.weights / (1 + (off / (REACH * _deviation(off, weights))[..., None]) ** 2)


def fit_faces(directions: Numbers, inverse: Numbers, weights: Numbers) -> Faces:
    """Fit faces to readings of n objects.

    directions: (3, n, m). inverse: (n, m) inverse depths. weights: (n, m) pixels that each stands for, 0 for padding.
    """
    directions, inverse, weights = (each.astype(np.float32) for each in (directions, inverse, weights))
    ahead = np.arctan2(*(np.einsum("nm,nm->n", weights, directions[axis]) for axis in (1, 0)))
    x, y, z = _turned(directions, ahead)
    order = np.argsort(np.where(weights > 0, np.arctan2(y, x), np.inf), axis=1)
    places = np.where(np.arange(weights.shape[1]) < (weights > 0).sum(axis=1, keepdims=True), order, order[:, :1])
    x, y, z, w = (np.take_along_axis(each, places, 1) for each in (x, y, z, inverse))
    products = np.stack([x * x, x * y, y * y, x * w, y * w], axis=2)
    readings = _Readings(x, y, z, w, np.take_along_axis(weights, order, 1), products)
    explanations = _explained(readings, _starts(z, w, readings.weights))
    forms, noise = _chosen(_polished(explanations, readings), readings)
    along = np.arctan2(forms[:, 0, 1], forms[:, 0, 0])
    x, y, z = _turned(forms.transpose(2, 0, 1), -ahead)
    return Faces(np.stack([x, y, z], axis=2), np.where(np.isfinite(along), along, 0) + ahead, noise)


def _explained(readings: _Readings, levels: Numbers) -> Numbers:
    """Return forms (h, n, 3, 3): each initial horizontal face (levels, n) with one upright face or with two."""
    z, w = readings.z, readings.w
    level, trust = levels[:, :, np.newaxis], np.broadcast_to(readings.weights, (*levels.shape, z.shape[1]))
    heights = z / np.maximum(w, _TINY)
    kappa = 1 / levels
    flat = np.where(level < 0, heights > level - LEAST_HEIGHT_M, heights < level + LEAST_HEIGHT_M)
    shares = shares_of(readings.products)
    pair = sums = scarce = np.empty(0, np.float32)
    for _ in range(ROUNDS):
        upright = np.where(flat, 0, trust)
        scarce = upright.sum(axis=2).reshape(-1) < _LEAST_SHARE * trust.sum(axis=2).reshape(-1)
        sums = moments_of_runs(upright, shares)
        pair = pair_of(sums)
        pair[scarce] = np.nan
        left, right, plane = readings.inverse(forms_of(pair, kappa.reshape(-1)).reshape(*levels.shape, 3, 3))
        walls, plane = _met(np.fmin(left, right)), np.maximum(plane, 0)
        flat = plane < walls
        kappa = _refitted(kappa, z, w, np.where(flat, trust, 0), trust)
        trust = readings.trusted(np.abs(w - np.fmin(np.fmin(walls, plane), _NEAREST)), trust)
    single = single_of(sums.sum(axis=2))
    single[scarce] = np.nan
    forms = [forms_of(each, kappa.reshape(-1)) for each in (pair, single)]
    return np.concatenate(forms).reshape(-1, *levels.shape[1:], 3, 3)


def _refitted(kappa: Numbers, z: Numbers, w: Numbers, on: Numbers, trust: Numbers) -> Numbers:
    """Return the horizontal faces that fit the readings on them, where there are enough."""
    enough = on.sum(axis=2) > _LEAST_SHARE * trust.sum(axis=2)
    onto = on * z
    better = np.einsum("hnm,nm->hn", onto, w) / np.maximum(np.einsum("hnm,nm->hn", onto, z), _TINY)
    return np.where(enough, better, kappa)


def _deviation(off: Numbers, weights: Numbers) -> Numbers:
    """Return the standard deviation of normal errors of such sizes."""
    return np.asarray(_NORMAL * (weights * off).sum(axis=-1) / np.maximum(weights.sum(axis=-1), _TINY) + _LEAST_NOISE)


def _turned(directions: Numbers, by: Numbers) -> tuple[Numbers, Numbers, Numbers]:
    """Return (3, n, m) directions in rotated axes."""
    cos, sin = np.cos(by)[:, None], np.sin(by)[:, None]
    x, y, z = directions
    return cos * x + sin * y, cos * y - sin * x, z


def _starts(z: Numbers, w: Numbers, share: Numbers) -> Numbers:
    """Return candidate heights of horizontal faces, (1 + LEVELS, n); NaN for none."""
    heights = np.sort(np.where(share > 0, z / np.maximum(w, _TINY), np.inf), axis=1)
    counts = (share > 0).sum(axis=1)
    rows = np.arange(len(heights))
    below = heights[rows, counts // 2] < 0
    found = np.full((len(heights), len(LEVELS) + 1), np.nan, np.float32)
    for number, each in enumerate(LEVELS):
        at = np.where(below, each, 1 - each) * (counts - 1)
        height = heights[rows, at.astype(np.intp)]
        found[:, number + 1] = np.where(np.where(below, -height, height) > LEAST_HEIGHT_M, height, np.nan)
    return found.T


def _seen(values: Numbers) -> Numbers:
    with np.errstate(invalid="ignore"):
        return np.where(values > _SEEN, values, np.inf)


def _met(values: Numbers) -> Numbers:
    """Return inverse depths where rays meet planes: 0 for rays that lead away, infinite without a plane."""
    with np.errstate(invalid="ignore"):
        return np.maximum(np.fmin(values, np.float32(np.inf)), 0)


def _inverse(forms: Numbers, directions: Numbers) -> Numbers:
    """Return the inverse depth of each of forms (..., n, 3, 3) in directions (n, 3, m): (..., n, 3, m)."""
    with np.errstate(invalid="ignore"):
        return np.asarray(forms @ directions)


def _least(values: Numbers) -> Numbers:
    return np.asarray(_seen(values).min(axis=-2))


def _chosen(explanations: Numbers, readings: _Readings) -> tuple[Numbers, Numbers]:
    """Return the smallest of each object's likely explanations (h, n, 3, 3), and its residual noise."""
    left, right, plane = readings.inverse(explanations)
    model = np.minimum(_met(np.fmin(np.fmin(left, right), plane)), _NEAREST)
    off = np.abs(readings.w - model)
    noise = _deviation(off, readings.weights).min(axis=0)
    cost = (readings.weights * np.minimum((off / noise[:, None]) ** 2, REACH**2)).sum(axis=2) / COHERENT
    size = np.zeros(cost.shape, np.float32)
    depth = 1 / np.maximum(model, _SEEN)
    for direction in (readings.x, readings.y, readings.z):
        place = direction * depth
        size += (place.max(axis=2) - place.min(axis=2)) ** 2
    best = np.where(cost <= cost.min(axis=0) + LIKELY, size, np.inf).argmin(axis=0)
    return explanations[best, np.arange(len(best))], noise


def _polished(forms: Numbers, readings: _Readings) -> Numbers:
    """Return forms (h, n, 3, 3) whose upright faces fit their readings, turned by POLISH at most."""
    first, second, plane = (_seen(values) for values in readings.inverse(forms))
    least = np.minimum(np.minimum(first, second), plane)
    trust = readings.trusted(np.abs(readings.w - np.minimum(least, _NEAREST)), readings.weights)
    on_first = first == least
    left = _moments(np.where(on_first, trust, 0), readings)
    right = _moments(np.where((second == least) > on_first, trust, 0), readings)
    return refined(forms.reshape(-1, 3, 3), left, right).reshape(forms.shape)


def _moments(weights: Numbers, readings: _Readings) -> Numbers:
    """Return the moments (5, h * n) of readings of n objects with (h, n, m) weights."""
    sums = weights.transpose(1, 0, 2) @ readings.products
    return sums.transpose(2, 1, 0).reshape(5, -1)
