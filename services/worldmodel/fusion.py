"""Makes what is known of objects better by sightings of them: edges, heights, boxes. Pure.

Views of one robot that follow each other are off by the same: together they say little more than one of where an object
is. So edges get the pose's share of their noise as often as views come within the time in which that becomes another.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.worldmodel.classes import Classes
from services.worldmodel.objects import Objects
from services.worldmodel.placement import UNITS, Sightings

Floats = NDArray[np.float64]

ANGLES: Final = 12
_YAWS: Final = np.arange(ANGLES) * (np.pi / 2 / ANGLES)
_TURNS: Final = np.arctan2(UNITS[:, 1], UNITS[:, 0])[np.newaxis, :] - _YAWS[:, np.newaxis]
_SIDES: Final = np.stack([np.abs(np.cos(_TURNS)), np.abs(np.sin(_TURNS))], axis=2) / 2
"""How edges follow from (length, width) for each yaw, (ANGLES, REACHES, 2); from (x, y) they follow by UNITS."""

_PLACES: Final = np.einsum("rk,rl->rkl", UNITS, UNITS).reshape(len(UNITS), -1)
_MIXED: Final = np.einsum("rk,arl->rakl", UNITS, _SIDES).reshape(len(UNITS), -1)
_SIZES: Final = np.einsum("ark,arl->rakl", _SIDES, _SIDES).reshape(len(UNITS), -1)
_BY_SIDE: Final = _SIDES.transpose(1, 0, 2).reshape(len(UNITS), -1)

SHORTEST_M: Final = 0.05
SHAPE_M: Final = 0.03
"""How much an object's outline differs from a box's, 1 sigma."""

LOOSE: Final = 0.5
"""How far a centre is from its hint, 1 sigma, by the usual length."""


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Fitted boxes: centre (n, 2), its covariance (n, 2, 2), length and width (n, 2), yaw (n,), edges (n, REACHES)."""

    centre: Floats
    covariance: Floats
    size: Floats
    yaw: Floats
    outline: Floats


def fitted(edges: Floats, variance: Floats, sizes: Floats, hint: Floats) -> Boxes:
    """Fit an upright box to each of n outlines.

    edges, variance: (n, REACHES), infinite variance for edges that are not known. sizes: (n, 3) usual length and width,
    and how much they vary. hint: (n, 2) about where the centre is.

    For each yaw it is a least-squares problem of four unknowns. The place's block of its normal matrix is the same for
    all yaws; the sizes are solved for by that block's Schur complement.
    """
    count, rows = len(edges), np.arange(len(edges))
    weights = 1 / (variance + SHAPE_M**2)
    near = edges - hint @ UNITS.T  # numbers stay small far from the map's origin
    pulled = np.where(weights > 0, weights * near, 0.0)
    prior, loose = 1 / np.square(sizes[:, 2]), 1 / np.square(LOOSE * sizes[:, 0])
    place = (weights @ _PLACES).reshape(count, 1, 2, 2) + loose.reshape(count, 1, 1, 1) * np.identity(2)
    mixed = (weights @ _MIXED).reshape(count, ANGLES, 2, 2)
    sized = (weights @ _SIZES).reshape(count, ANGLES, 2, 2) + prior.reshape(count, 1, 1, 1) * np.identity(2)
    place_covariance = _inverses(place)
    centre = np.einsum("nkl,nl->nk", place_covariance[:, 0], pulled @ UNITS)
    moving = place_covariance @ mixed
    covariance = _inverses(sized - mixed.swapaxes(2, 3) @ moving)
    left = (pulled @ _BY_SIDE).reshape(count, ANGLES, 2) - np.einsum("nakl,nk->nal", mixed, centre)
    usual = (prior[:, np.newaxis] * sizes[:, :2])[:, np.newaxis]
    both = np.stack([left + usual, left + usual[..., ::-1]], axis=1)  # the longer side may be either
    solved = np.einsum("nakl,nsal->nsak", covariance, both)
    side, angle = np.divmod(np.einsum("nsak,nsak->nsa", both, solved).reshape(count, -1).argmax(axis=1), ANGLES)
    sides, moving = solved[rows, side, angle], moving[rows, angle]
    centre = centre - np.einsum("nkl,nl->nk", moving, sides)
    centre_covariance = place_covariance[:, 0] + moving @ covariance[rows, angle] @ moving.swapaxes(1, 2)
    sides = np.maximum(sides, SHORTEST_M)
    outline = np.einsum("nrk,nk->nr", _SIDES[angle], sides) + (centre + hint) @ UNITS.T
    longer = sides[:, 0] >= sides[:, 1]
    size = np.where(longer[:, np.newaxis], sides, sides[:, ::-1])
    yaw = np.where(longer, _YAWS[angle], _YAWS[angle] + np.pi / 2)
    return Boxes(centre + hint, centre_covariance, size, yaw, outline)


def _inverses(matrices: Floats) -> Floats:
    """Return the inverses of symmetric matrices (..., 2, 2)."""
    xx, xy, yy = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    made = np.stack([yy, -xy, -xy, xx], axis=-1) / (xx * yy - xy * xy)[..., np.newaxis]
    return np.asarray(made.reshape(matrices.shape))


Rows = NDArray[np.intp]
Bools = NDArray[np.bool_]

NS: Final = 1_000_000_000
PULL: Final = 3.0
"""How much faster than localisation errors change objects are drawn to where poses as they came say that they are."""

GROWN_M: Final = 0.08
GROWN_SIGMAS: Final = 2.5
"""An edge that is farther out by so much, and so many standard deviations, had not been seen whole."""

SHORT_SIGMAS: Final = 2.0
SHORT: Final = 10.0
"""How much less an edge counts that falls short by so many standard deviations: it may be hidden."""

SHORT_HEIGHT_M: Final = 0.06
LEAST_VARIANCE: Final = 4e-5
MOST_REPEATS: Final = 100.0
MOST_NOISE: Final = 4.0
BEYOND: Final = 4.0
HINT: Final = 0.1
_SQUARES: Final = np.stack([UNITS[:, 0] ** 2, 2 * UNITS[:, 0] * UNITS[:, 1], UNITS[:, 1] ** 2])
_HIDDEN: Final = 1e6


def along_edges(pose: Floats) -> Floats:
    """Return the variance along each direction (n, REACHES) of covariances (n, 3; xx, xy, yy)."""
    return np.asarray(pose @ _SQUARES)


def is_compound(seen: Sightings, classes: Classes) -> Bools:
    """Return which sightings are higher than things of their class are: several on top of each other."""
    usual = classes.sizes[seen.classes]
    return np.asarray(seen.high - seen.low > usual[:, 2] + 3 * usual[:, 4] + 2 * np.sqrt(seen.height_noise))


def hints(seen: Sightings, classes: Classes) -> Floats:
    """Return about where objects' centres are: behind the middle of what is seen of them (n, 2)."""
    flat = np.maximum(np.hypot(*seen.away.T), 0.1)
    return np.asarray(seen.middle + seen.away * (classes.sizes[seen.classes, 1] / 3 / flat)[:, np.newaxis])


def begin(objects: Objects, rows: Rows, seen: Sightings, pose: Floats, classes: Classes) -> None:
    """Make new objects, one of each sighting."""
    objects.cls[rows] = seen.classes
    objects.edges[rows], objects.variance[rows] = seen.edges, seen.noise + along_edges(pose)
    objects.hint[rows] = hints(seen, classes)
    heights = classes.sizes[seen.classes, 2]
    objects.low[rows], objects.high[rows] = seen.low, seen.high
    objects.low_variance[rows] = np.where(seen.low_known, seen.height_noise, heights**2)
    objects.high_variance[rows] = np.where(seen.high_known, seen.height_noise, heights**2)


def fuse(objects: Objects, classes: Classes, rows: Rows, seen: Sightings, *, pose: Floats, repeats: Floats) -> None:
    """Fuse each object with one sighting. repeats: see the module."""
    objects.hint[rows] += HINT * (hints(seen, classes) - objects.hint[rows])
    times = np.clip(repeats, 1.0, MOST_REPEATS)[:, np.newaxis]
    noise = seen.noise * np.minimum(times, MOST_NOISE) + along_edges(pose) * times
    before, variance = objects.edges[rows], objects.variance[rows]
    measured = np.isfinite(noise)
    first = np.isinf(variance) & measured
    finite = np.where(measured, noise, 0) + np.where(np.isinf(variance), 0, variance)
    residual = np.where(measured, seen.edges - before, 0.0)
    sigmas = np.sqrt(finite)
    noise = np.where(~first & (residual < -SHORT_SIGMAS * sigmas), noise * SHORT, noise)
    grown = ~first & (residual > GROWN_M) & (residual > GROWN_SIGMAS * sigmas)
    variance = np.where(grown, np.maximum(variance, np.square(residual / 2)), variance)
    with np.errstate(invalid="ignore"):
        gain = np.where(first, 1.0, np.where(measured, variance / (variance + noise), 0.0))
        left = np.where(gain > 0, (1 - gain) * variance, variance)
    objects.edges[rows] = before + gain * residual
    objects.variance[rows] = np.where(first, noise, left)
    _fuse_heights(objects, rows, seen, is_compound(seen, classes))


def _fuse_heights(objects: Objects, rows: Rows, seen: Sightings, compound: Bools) -> None:
    for value, known, kept, variance, outward in (
        (seen.low, seen.low_known & ~compound, objects.low, objects.low_variance, -1.0),
        (seen.high, seen.high_known & ~compound, objects.high, objects.high_variance, 1.0),
    ):
        residual = value - kept[rows]
        beyond = residual * outward > 0
        noise = seen.height_noise * np.where(known, 1.0, np.where(beyond & ~compound, BEYOND, _HIDDEN))
        noise = np.where(~beyond & (np.abs(residual) > SHORT_HEIGHT_M), noise * SHORT, noise)
        gain = variance[rows] / (variance[rows] + noise)
        kept[rows] += gain * residual
        variance[rows] = np.maximum((1 - gain) * variance[rows], LEAST_VARIANCE)


def draw_to_poses(
    objects: Objects, rows: Rows, *, offsets: Floats, away: Floats, at_ns: NDArray[np.int64], seconds: float
) -> None:
    """Draw objects to where poses as they came say that they are: offsets only tell robots apart.

    offsets: (n, 3) x, y, yaw that poses were corrected by. away: (n, 2) where each is from its camera. seconds: until a
    localisation error is another one.
    """
    passed = np.clip((at_ns - objects.last_ns[rows]) / NS, 0.0, 1.0)
    objects.watched_s[rows] += passed
    share = PULL * passed / (seconds + objects.watched_s[rows])
    x, y, yaw = offsets.T
    by = -np.stack([x - yaw * away[:, 1], y + yaw * away[:, 0]], axis=1) * share[:, np.newaxis]
    objects.shift(rows, by, by @ UNITS.T)


def fit(objects: Objects, rows: Rows, classes: Classes) -> None:
    """Fit boxes to what is known of objects now."""
    sizes = classes.sizes[objects.cls[rows]][:, [0, 1, 3]]
    box = fitted(objects.edges[rows], objects.variance[rows], sizes, objects.hint[rows])
    objects.centre[rows], objects.covariance[rows], objects.size[rows] = box.centre, box.covariance, box.size
    objects.yaw[rows], objects.outline[rows] = box.yaw, box.outline
    objects.fits[rows] = 0
