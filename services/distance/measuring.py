"""What depth says of the objects of one image. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from schemas.distances import Measured, ObjectDistance, Place
from schemas.space import MAX_COORDINATE_M
from services.geometry.camera import CameraModel
from services.geometry.errors import GeometryError
from services.geometry.foreground import foreground, on_surface
from services.geometry.masks import Window, decode, eroded, surroundings
from services.geometry.rotation import moved

Floats = NDArray[np.float32]
Indices = NDArray[np.intp]

SAMPLE: Final = 512
"""Readings of an object that its statistics are made of, spread evenly over it."""

AROUND: Final = 256
"""Readings around it."""

FILLED: Final = SAMPLE // 8
"""Where fewer pixels than this have a reading near, of SAMPLE, those that have one are taken."""

REACH: Final = 2
"""A pixel without a reading counts as the nearest one of its row that has one, at most so many pixels away."""

RING: Final = 5
"""Pixels around a mask that say what is behind and before the object."""

_EVEN: Final = {count: np.arange(count) for count in (SAMPLE, AROUND)}
_NONE: Final = np.zeros(AROUND, np.intp)
_NOISE: Final = 0.01
"""Share of an object's readings that are nearer than its nearest point."""

_NOWHERE: Final = "by the camera's distortion model its pixels look nowhere"
_SIGMA: Final = 1.4826
"""Standard deviations of a normal distribution in one median absolute deviation."""


@dataclass(frozen=True, slots=True)
class Criteria:
    """When readings count. min_pixels: valid ones that an object needs. edge: pixels taken off at a mask's edges."""

    min_pixels: int = 30
    edge: int = 0


@dataclass(frozen=True, slots=True)
class Frame:
    """A further frame of reference. from_camera: 4 x 4, or why it is not known."""

    frame_id: str
    from_camera: NDArray[Any] | str


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Depth as the colour camera sees it: depth_m is height x width in metres, NaN for no reading.

    frame_id: the camera's optical frame. camera: its model, or why there is none.
    """

    depth_m: Floats
    frame_id: str
    camera: CameraModel | str
    frames: Sequence[Frame] = ()


def measure(objects: Sequence[Detection], view: View, criteria: Criteria) -> list[ObjectDistance]:
    """Measure each object of an image of the view's size.

    Raises:
        GeometryError: the camera is calibrated for pictures of another size.
    """
    if isinstance(view.camera, CameraModel):
        view.camera.check_size(*view.depth_m.shape)
    looked = [_look(index, found, view.depth_m, criteria) for index, found in enumerate(objects)]
    seen = [each for each in looked if isinstance(each, _Seen)]
    measured = _measured(seen, view) if seen else iter(())
    return [next(measured) if isinstance(each, _Seen) else each for each in looked]


def unknown(objects: Sequence[Detection], reason: str) -> list[ObjectDistance]:
    """Say of each object that nothing is known, and why."""
    return [_unknown(index, found, 0.0, reason) for index, found in enumerate(objects)]


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """An object with enough readings: some pixels of its window that have one, within the mask and just around it."""

    index: int
    found: Detection
    window: Window
    share: float
    mean_m: float
    within: Indices
    around: Indices


def _look(index: int, found: Detection, depth_m: Floats, criteria: Criteria) -> _Seen | ObjectDistance:
    if found.mask is None:
        return _unknown(index, found, 0.0, "the model gives no masks")
    try:
        window = decode(found.mask, margin=RING)
    except GeometryError as error:
        return _unknown(index, found, 0.0, str(error))
    patch = depth_m[window.place]
    there = patch > 0
    valid = window.pixels & there
    count, area = int(np.count_nonzero(valid)), window.area
    share = count / area if area else 0.0
    if count < criteria.min_pixels:
        reason = f"{count} of its {area} pixels have a reading, {criteria.min_pixels} are needed"
        return _unknown(index, found, share, reason)
    mask = eroded(window, criteria.edge).pixels
    inner = np.flatnonzero(mask & there)
    if len(inner) < criteria.min_pixels:
        mask, inner = window.pixels, np.flatnonzero(valid)
    within = _filled(_spread(np.flatnonzero(mask), SAMPLE), inner)
    around = np.flatnonzero(surroundings(window, RING) & there)
    mean = cv2.mean(patch, valid.view(np.uint8))[0]
    return _Seen(index, found, window, share, mean, within, _spread(around, AROUND))


def _unknown(index: int, found: Detection, share: float, reason: str) -> ObjectDistance:
    return ObjectDistance(name=found.name, index=index, valid_share=share, unknown=reason)


def _spread(chosen: Indices, count: int) -> Indices:
    """Return so many of some pixels, evenly spread, or _NONE of them."""
    return chosen[_EVEN[count] * len(chosen) // count] if len(chosen) else _NONE


def _filled(wanted: Indices, there: Indices) -> Indices:
    """Return SAMPLE pixels with readings, instead of some that may have none; both ascending.

    Readings are lost at edges and in shadows: without those beside them what is there would not count.
    """
    after = np.searchsorted(there, wanted)
    nexts, lasts = there[np.minimum(after, len(there) - 1)], there[np.maximum(after - 1, 0)]
    to_next, to_last = np.abs(nexts - wanted), np.abs(wanted - lasts)
    nearest = np.where(to_next <= to_last, nexts, lasts)[np.minimum(to_next, to_last) <= REACH]
    return _spread(nearest if len(nearest) >= FILLED else there, SAMPLE)


def _in_image(pixels: Sequence[Indices], seen: Sequence[_Seen], width: int) -> Indices:
    """Return where in a flat image so wide pixels of objects' windows are."""
    windows = np.array([(each.window.top, each.window.left, each.window.pixels.shape[1]) for each in seen])
    top, left, across = windows.T[:, :, np.newaxis]
    rows, columns = np.divmod(np.stack(pixels), across)
    return np.asarray((rows + top) * width + columns + left)


def _measured(seen: Sequence[_Seen], view: View) -> Iterator[ObjectDistance]:
    flat = view.depth_m.ravel()
    width = view.depth_m.shape[1]
    at = _in_image([each.within for each in seen], seen, width)
    z = flat[at]
    order = np.argsort(z, axis=1)
    z, at = np.take_along_axis(z, order, 1).astype(np.float64), np.take_along_axis(at, order, 1)
    around = flat[_in_image([each.around for each in seen], seen, width)]
    around[[each.around is _NONE for each in seen]] = np.nan
    own = foreground(z, np.sort(around, axis=1))
    axial = _medians(z, own)
    spread = _SIGMA * _medians(np.abs(z - axial[:, np.newaxis]), own)
    solid = own & on_surface(z)
    scattered = ~solid.any(axis=1)
    solid[scattered] = own[scattered]
    euclidean, places = _placed(z, at, own, solid, view)
    for row, each in enumerate(seen):
        yield ObjectDistance(
            name=each.found.name,
            index=each.index,
            valid_share=each.share,
            measured=Measured(
                axial_m=float(axial[row]),
                euclidean_m=euclidean[row],
                mean_m=each.mean_m,
                nearest_m=float(z[row, solid[row]][int(solid[row].sum() * _NOISE)]),
                spread_m=float(spread[row]),
                places=places[row],
            ),
        )


def _medians(values: NDArray[Any], own: NDArray[np.bool_]) -> NDArray[Any]:
    """Return the median of each row's own values; NaN where there are none."""
    ascending = np.sort(np.where(own, values, np.inf), axis=1)
    counts = own.sum(axis=1)
    rows = np.arange(len(values))
    middle = (ascending[rows, (counts - 1) // 2] + ascending[rows, counts // 2]) / 2
    return np.where(counts > 0, middle, np.nan)


def _placed(
    z: NDArray[Any], at: Indices, own: NDArray[np.bool_], solid: NDArray[np.bool_], view: View
) -> tuple[list[float | None], list[list[Place]]]:
    """Return each object's straight distance, and the middle of its solid readings in each frame."""
    names = [view.frame_id, *(frame.frame_id for frame in view.frames)]
    if isinstance(view.camera, str):
        return [None] * len(z), [[Place(frame_id=name, unknown=view.camera) for name in names]] * len(z)
    x, y = (plane[at] for plane in view.camera.rays(*view.depth_m.shape).reshape(2, -1))
    own, solid = own & np.isfinite(x), solid & np.isfinite(x)
    straight = _medians(z * view.camera.lengths(*view.depth_m.shape).ravel()[at], own)
    weights = np.where(solid, z, 0.0) / np.maximum(solid.sum(axis=1, keepdims=True), 1)
    middles = np.stack([np.sum(np.where(solid, ray, 0) * weights, axis=1) for ray in (x, y, 1)], axis=1)
    places = [_in_frame(view.frame_id, middles, np.identity(4))]
    places += [_in_frame(frame.frame_id, middles, frame.from_camera) for frame in view.frames]
    seen = np.isfinite(straight)
    return (
        [float(each) if known else None for each, known in zip(straight, seen, strict=True)],
        [
            list(of) if known else [Place(frame_id=name, unknown=_NOWHERE) for name in names]
            for of, known in zip(zip(*places, strict=True), seen, strict=True)
        ],
    )


def _in_frame(frame_id: str, middles: NDArray[Any], from_camera: NDArray[Any] | str) -> list[Place]:
    if isinstance(from_camera, str):
        return [Place(frame_id=frame_id, unknown=from_camera)] * len(middles)
    return [_place(frame_id, at) for at in moved(from_camera, middles).tolist()]


def _place(frame_id: str, at: Sequence[float]) -> Place:
    if max(map(abs, at)) > MAX_COORDINATE_M:
        return Place(frame_id=frame_id, unknown=f"more than {MAX_COORDINATE_M:g} m away by the transforms")
    x, y, z = at
    return Place(frame_id=frame_id, at=(x, y, z))
