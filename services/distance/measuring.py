"""Measures the objects of one image in depth. Pure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection
from schemas.distances import Measured, ObjectDistance, Place
from schemas.header import MAX_LABEL
from schemas.space import MAX_COORDINATE_M, MAX_DISTANCE_M
from services.distance.depth_readings import RING, Criteria, Picked, pick
from services.distance.keypoints import NEEDED, KeypointReadings, read_keypoints
from services.geometry.camera import CameraModel
from services.geometry.depth import Depth
from services.geometry.errors import GeometryError, MaskError
from services.geometry.foreground import foreground, on_surface
from services.geometry.masks import MEASURED_PIXELS, Window, decode_all
from services.geometry.rotation import moved

Floats = NDArray[np.float32]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

AT_ONCE: Final = 1 << 21
"""Pixels of the windows of objects that are measured together, and of one window: larger ones are thinned."""

_NOISE: Final = 0.01
"""Share of an object's readings that may be nearer than its reported nearest point."""

_NOWHERE: Final = "the camera's distortion model gives its pixels no direction"
_SIGMA: Final = 1.4826
"""Standard deviations of a normal distribution in one median absolute deviation."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A target frame of reference. from_camera: 4 x 4 transform, or why it is unknown."""

    frame_id: str
    from_camera: NDArray[Any] | str


@dataclass(frozen=True, slots=True, eq=False)
class DepthView:
    """Depth seen from the colour camera.

    frame_id: the camera's optical frame. camera: its model, or why there is none.
    """

    depth: Depth
    frame_id: str
    camera: CameraModel | str
    frames: Sequence[Frame] = ()


def measure(
    objects: Sequence[Detection], view: DepthView, criteria: Criteria, most: int = MEASURED_PIXELS
) -> list[ObjectDistance]:
    """Measure each object of an image of the view's size. most: pixels of their masks that are measured.

    Raises:
        GeometryError: the camera is calibrated for pictures of another size.
    """
    if isinstance(view.camera, CameraModel):
        view.camera.check_size(*view.depth.shape)
    measured: dict[int, ObjectDistance] = {}
    for windows in groups(objects, measured, most):
        measured.update((each.index, each) for each in _measured(objects, windows, view, criteria))
    for index, readings in read_keypoints(objects, view.depth):
        if objects[index].mask is None:
            measured[index] = _by_keypoints(index, objects[index], readings, view)
        measured[index] = _with_keypoints(measured[index], readings, view)
    return [measured[index] for index in range(len(objects))]


def _by_keypoints(index: int, found: Detection, readings: KeypointReadings, view: DepthView) -> ObjectDistance:
    """Return the distance of an object without a mask: what most of its keypoints in view agree on."""
    z = readings.z
    own = readings.near(float(np.nanmedian(z)) if np.isfinite(z).any() else np.nan)
    count, in_view = int(own.sum()), max(readings.in_view, 1)
    if count < NEEDED:
        reason = (
            f"{count} of its {readings.in_view} keypoints in view have a reading near each other, {NEEDED} are needed"
        )
        return _unknown(index, found, count / in_view, reason)
    near = z[own]
    row = np.where(own, z, 0.0)[np.newaxis].astype(np.float32)
    ((euclidean_m,), (places,)) = _placed(row, readings.at[np.newaxis], own[np.newaxis], own[np.newaxis], view)
    axial_m = float(np.median(near))
    measured = Measured(
        axial_m=axial_m,
        euclidean_m=euclidean_m,
        mean_m=float(near.mean()),
        nearest_m=float(near.min()),
        spread_m=float(_SIGMA * np.median(np.abs(near - axial_m))),
        places=places,
    )
    return ObjectDistance(
        name=found.name, index=index, track=found.track, valid_share=count / in_view, measured=measured
    )


def _with_keypoints(measured: ObjectDistance, readings: KeypointReadings, view: DepthView) -> ObjectDistance:
    """Return an object's distance with the places of its keypoints."""
    if measured.measured is None or isinstance(view.camera, str):
        return measured
    z, (x, y) = readings.z, view.camera.rays_of(readings.at)
    points = np.stack([x * z, y * z, z], axis=1)
    own = readings.near(measured.measured.axial_m)
    moves = [np.identity(4), *(frame.from_camera for frame in view.frames)]
    places = [
        place
        if place.at is None or isinstance(move, str)
        else msgspec.structs.replace(place, keypoints=_vectors(moved(move, points), own))
        for place, move in zip(measured.measured.places, moves, strict=True)
    ]
    return msgspec.structs.replace(measured, measured=msgspec.structs.replace(measured.measured, places=places))


def _vectors(points: NDArray[Any], own: Bools) -> list[tuple[float, float, float] | None]:
    own = own & (np.abs(points) <= MAX_COORDINATE_M).all(axis=1)  # False of NaN
    return [(x, y, z) if known else None for (x, y, z), known in zip(points.tolist(), own.tolist(), strict=True)]


def measure_apart(objects: Sequence[Detection], view: DepthView, criteria: Criteria) -> list[ObjectDistance]:
    """Measure like `measure`, but if one object fails, only that object is unknown.

    Each then has an equal share of the pixels that are measured: alone, any of them could take all.

    Raises:
        GeometryError: see `measure`.
    """
    try:
        return measure(objects, view, criteria)
    except GeometryError:
        raise
    except Exception:  # noqa: BLE001 - which object it was, and why, is found out below
        most = MEASURED_PIXELS // len(objects)
        return [_alone(index, found, view, criteria, most) for index, found in enumerate(objects)]


def _alone(index: int, found: Detection, view: DepthView, criteria: Criteria, most: int) -> ObjectDistance:
    try:
        (only,) = measure([found], view, criteria, most)
    except Exception as error:  # noqa: BLE001 - said of the object
        return _unknown(index, found, 0.0, f"it failed: {error!r}"[:MAX_LABEL])
    return msgspec.structs.replace(only, index=index)


def unknown(objects: Sequence[Detection], reason: str) -> list[ObjectDistance]:
    """Return every object as unknown, with the reason."""
    return [_unknown(index, found, 0.0, reason) for index, found in enumerate(objects)]


def _unknown(index: int, found: Detection, share: float, reason: str) -> ObjectDistance:
    return ObjectDistance(name=found.name, index=index, track=found.track, valid_share=share, unknown=reason)


def groups(
    objects: Sequence[Detection], unmeasured: dict[int, ObjectDistance], most: int = MEASURED_PIXELS
) -> Iterator[dict[int, Window]]:
    """Yield the decoded masks of objects, some at a time, by index; failures go to `unmeasured`."""
    masks = {index: found.mask for index, found in enumerate(objects) if found.mask is not None}
    windows: dict[int, Window] = {}
    pixels = 0
    decoded = decode_all(masks.values(), margin=RING, most=most, each=AT_ONCE)
    for index, window in zip(masks, decoded, strict=True):
        if isinstance(window, MaskError):
            unmeasured[index] = _unknown(index, objects[index], 0.0, str(window))
            continue
        pixels += window.pixels.size
        if windows and pixels > AT_ONCE:
            yield windows
            windows, pixels = {}, window.pixels.size
        windows[index] = window
    if windows:
        yield windows
    for index in set(range(len(objects))).difference(masks):
        unmeasured[index] = _unknown(index, objects[index], 0.0, "the model gives no masks")


def _measured(
    objects: Sequence[Detection], windows: Mapping[int, Window], view: DepthView, criteria: Criteria
) -> Iterator[ObjectDistance]:
    picked = pick(list(windows.values()), view.depth, criteria)
    known = dict(zip(picked.rows.tolist(), _known(picked, view), strict=True)) if len(picked.rows) else {}
    numbers = (each.tolist() for each in (picked.counts, picked.areas, picked.own))
    for row, (index, count, area, own) in enumerate(zip(windows, *numbers, strict=True)):
        share = count / area if area else 0.0
        if row in known:
            found = objects[index]
            yield ObjectDistance(
                name=found.name, index=index, track=found.track, valid_share=share, measured=known[row]
            )
        else:
            why = (
                f"{criteria.min_pixels} are needed" if own else "all from its surroundings: it returns no depth itself"
            )
            reason = f"{count} of its {area} pixels have a reading, {why}"
            yield _unknown(index, objects[index], share, reason)


def _known(picked: Picked, view: DepthView) -> Iterator[Measured]:
    z = picked.z
    own = foreground(z, picked.around)
    axial, spread, solid = own_readings(picked, own)
    order = solid.cumsum(axis=1)
    nearest = z[np.arange(len(z)), (order > (order[:, -1:] * _NOISE).astype(np.intp)).argmax(axis=1)]
    numbers = (each.tolist() for each in (axial, picked.mean_m[picked.rows], nearest, spread))
    for axial_m, mean_m, nearest_m, spread_m, euclidean_m, places in zip(
        *numbers, *_placed(z, picked.at, own, solid, view), strict=True
    ):
        yield Measured(
            axial_m=axial_m,
            euclidean_m=euclidean_m,
            mean_m=mean_m,
            nearest_m=nearest_m,
            spread_m=spread_m,
            places=places,
        )


def own_readings(picked: Picked, own: Bools | None = None) -> tuple[NDArray[Any], NDArray[Any], Bools]:
    """Return the median distance of each object's own readings, its spread, and which readings are on its surface."""
    z = picked.z
    own = foreground(z, picked.around) if own is None else own
    axial = _medians(z, own)
    spread = _SIGMA * _medians(np.abs(z - axial[:, np.newaxis]), own)
    return axial, spread, _else(own & on_surface(z), own)


def _else(some: Bools, other: Bools) -> Bools:
    """Return each row of the first array, or of the second where the first has nothing set."""
    return np.where(some.any(axis=1, keepdims=True), some, other)


def _medians(values: NDArray[Any], own: Bools) -> NDArray[Any]:
    """Return the median of each row's own values; NaN where there are none."""
    ascending = np.sort(np.where(own, values, np.inf), axis=1)
    counts = own.sum(axis=1)
    rows = np.arange(len(values))
    middle = (ascending[rows, (counts - 1) // 2] + ascending[rows, counts // 2]) / 2
    return np.where(counts > 0, middle, np.nan)


def _placed(
    z: Floats, at: Indices, own: Bools, solid: Bools, view: DepthView
) -> tuple[list[float | None], list[list[Place]]]:
    """Return each object's straight-line distance, and the centre of its solid readings in each frame."""
    names = [view.frame_id, *(frame.frame_id for frame in view.frames)]
    if isinstance(view.camera, str):
        return [None] * len(z), [[Place(frame_id=name, unknown=view.camera) for name in names]] * len(z)
    x, y = view.camera.rays_of(at)
    if not (somewhere := np.isfinite(x)).all():
        own = own & somewhere
        solid = _else(solid & somewhere, own)
        x, y = np.where(somewhere, x, 0), np.where(somewhere, y, 0)
    straight = _medians(z * np.sqrt(1 + x * x + y * y), own)
    weights = np.where(solid, z, 0.0) / np.maximum(solid.sum(axis=1, keepdims=True), 1)
    middles = np.stack([*(np.einsum("nm,nm->n", ray, weights) for ray in (x, y)), weights.sum(axis=1)], axis=1)
    places = [_in_frame(view.frame_id, middles, np.identity(4))]
    places += [_in_frame(frame.frame_id, middles, frame.from_camera) for frame in view.frames]
    seen = straight <= MAX_DISTANCE_M
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
        return Place(frame_id=frame_id, unknown=f"more than {MAX_COORDINATE_M:g} m away according to the transforms")
    x, y, z = at
    return Place(frame_id=frame_id, at=(x, y, z))
