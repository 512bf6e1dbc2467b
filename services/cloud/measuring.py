"""Detections and points of the same instant to the clouds of the objects. Pure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection, Detections
from schemas.header import Header
from schemas.objects import MAX_OBJECT_POINTS, ObjectCloud, ObjectClouds, Shape, UprightBox
from schemas.transforms import Transform
from services.cloud.errors import CloudError
from services.cloud.outliers import crowded, own
from services.cloud.outlines import AT_ONCE, Candidates, Masked, RegisteredView, View, in_window
from services.cloud.points import Bytes, Floats, Indices, Points
from services.cloud.sampling import some
from services.cloud.shape import Box, Level, fit_box
from services.cloud.visible import Seen, shapes
from services.geometry.errors import MaskError
from services.geometry.masks import Window, decode_all
from services.geometry.rotation import quaternion_of

Numbers = NDArray[np.float64]

NO_MASK: Final = "its detection has no mask: the model does not segment"
ROS_UP: Final = np.array([0.0, 0.0, 1.0])
ROS_LEVEL: Final = Level.of(ROS_UP)
OPTICAL_UP: Final = np.array([0.0, -1.0, 0.0])
OPTICAL: Final = "optical"


@dataclass(frozen=True, slots=True)
class Limits:
    """What becomes of an object's points.

    min_points: fewer are no object. max_points: of more, so many are kept. voxel_m: the edge of cubes of each of which
    one point is kept, 0 to keep all.
    """

    min_points: int = 10
    max_points: int = 100_000
    voxel_m: float = 0.0

    def thinned(self, xyz: Floats) -> Indices:
        """Return which of (3, n) points are kept."""
        if not self.voxel_m or not xyz.size:
            return some(xyz.shape[1], self.max_points)
        cells = np.floor((xyz - xyz.min(axis=1, keepdims=True)) / np.float32(self.voxel_m)).astype(np.int64)
        _, kept = np.unique((cells[0] << 42) | (cells[1] << 21) | cells[2], return_index=True)
        kept.sort()
        return np.asarray(kept[some(len(kept), self.max_points)])


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """The target frame; from_points: 4 x 4, moves the points into it, or absent where `unknown` says why."""

    frame_id: str = ""
    from_points: Numbers | None = None
    unknown: str = ""


def measure(
    detections: Detections, points: Points, view: View, *, of: Header, target: Target, limits: Limits, worker: str
) -> ObjectClouds:
    """Return the cloud of every detected object that has one, and why the others have none.

    of: the header of the points. view: them as the camera of the detections sees them.
    """
    here = Level.of(up_in(of.frame_id, target))
    unmeasured: dict[int, str] = {}
    masks = {index: Masked.of(window) for index, window in _masks(detections, unmeasured)}
    found = dict(_found(masks, view, limits, unmeasured))
    made = zip(found.items(), _colours(found, points), _shapes(found, masks, view, here), strict=True)
    objects = [
        _object(detections.objects[index], index, xyz, rgb, shape, here=here, target=target)
        for (index, (_, xyz)), rgb, shape in made
    ]
    return ObjectClouds(
        header=msgspec.structs.replace(detections.header, stamp_ns=of.stamp_ns, frame_id=of.frame_id),
        objects=objects,
        model=detections.model,
        worker=worker,
        target=_transform(of, target),
        unknown_target=target.unknown,
        unmeasured=unmeasured,
    )


def _colours(found: Mapping[int, tuple[Indices, Floats]], points: Points) -> list[Bytes | None]:
    """Return the colours of objects that consist of points (numbers in their cloud, coordinates)."""
    numbers = [at for at, _ in found.values()]
    rgb = points.take(np.concatenate(numbers)).rgb() if numbers else None
    if rgb is None:
        return [None] * len(numbers)
    return list(np.split(rgb, np.cumsum([len(at) for at in numbers])[:-1]))


def _shapes(
    found: Mapping[int, tuple[Indices, Floats]],
    masks: Mapping[int, Masked],
    view: View,
    level: Level,
) -> list[tuple[Numbers, Box]]:
    """Return centroids and boxes of objects that consist of points (numbers in their cloud, coordinates)."""
    if isinstance(view, RegisteredView) and view.factor == 1:
        seen = [
            Seen(masks[index], in_window(at, view.points.shape[1], masks[index].mask), xyz)
            for index, (at, xyz) in found.items()
        ]
        return shapes(seen, level)
    return [(xyz.mean(axis=1, dtype=np.float64), fit_box(xyz, level)) for _, xyz in found.values()]


def up_in(frame_id: str, target: Target) -> Numbers:
    """Return what is up for points in a frame: the target's z where that is known, else what ROS's REP 103 says."""
    if target.from_points is not None:
        return np.asarray(target.from_points[2, :3])
    return OPTICAL_UP if OPTICAL in frame_id else ROS_UP


def _masks(detections: Detections, unmeasured: dict[int, str]) -> Iterator[tuple[int, Window]]:
    """Decode the masks; why there is none goes to `unmeasured`."""
    masks = {index: found.mask for index, found in enumerate(detections.objects) if found.mask is not None}
    unmeasured.update(dict.fromkeys(set(range(len(detections.objects))).difference(masks), NO_MASK))
    for index, window in zip(masks, decode_all(masks.values()), strict=True):
        if isinstance(window, MaskError):
            unmeasured[index] = str(window)
        else:
            yield index, window


def _found(
    masks: Mapping[int, Masked], view: View, limits: Limits, unmeasured: dict[int, str]
) -> Iterator[tuple[int, tuple[Indices, Floats]]]:
    """Yield of each object which of a cloud's points are its own, and where they are, (3, n).

    Why there are none goes to `unmeasured`.
    """
    room = MAX_OBJECT_POINTS
    for group in _groups(zip(masks, view.within(list(masks.values())), strict=True), limits, unmeasured):
        for index, (at, xyz) in zip(group, _isolated(list(group.values())), strict=True):
            kept = _limited(at, xyz, limits)
            try:
                _check_enough(len(kept[0]), limits, "that stand out from what is behind it")
                _check_room(len(kept[0]), room)
            except CloudError as error:
                unmeasured[index] = str(error)
                continue
            room -= len(kept[0])
            yield index, kept


def _groups(
    candidates: Iterable[tuple[int, Candidates]], limits: Limits, unmeasured: dict[int, str]
) -> Iterator[dict[int, Candidates]]:
    """Return those that have enough points, some at a time."""
    group: dict[int, Candidates] = {}
    points = 0
    for index, each in candidates:
        try:
            _check_enough(len(each.at), limits, "within its mask")
        except CloudError as error:
            unmeasured[index] = str(error)
            continue
        group[index] = each
        points += len(each.at)
        if points > AT_ONCE:
            yield group
            group, points = {}, 0
    if group:
        yield group


def _isolated(group: Sequence[Candidates]) -> Iterator[tuple[Indices, Floats]]:
    """Yield which points are the foreground in each mask and stand not alone."""
    widths = np.array([each.width for each in group], np.float32)
    chosen = own([each.depth for each in group], widths, [each.around for each in group])
    kept = [_only(mine, each.at, each.xyz) for each, mine in zip(group, chosen, strict=True)]
    for (at, xyz), mine in zip(kept, crowded([xyz for _, xyz in kept]), strict=True):
        yield _only(mine, at, xyz)


def _only(chosen: NDArray[np.bool_] | None, at: Indices, xyz: Floats) -> tuple[Indices, Floats]:
    """Return the points that are chosen, None for all of them."""
    if chosen is None:
        return at, xyz
    which = np.flatnonzero(chosen)
    return at.take(which), xyz.take(which, axis=1)


def _limited(at: Indices, xyz: Floats, limits: Limits) -> tuple[Indices, Floats]:
    if not limits.voxel_m and len(at) <= limits.max_points:
        return at, xyz
    chosen = limits.thinned(xyz)
    return at[chosen], xyz.take(chosen, axis=1)


def _check_enough(count: int, limits: Limits, where: str) -> None:
    if count < limits.min_points:
        raise CloudError(f"{count} points {where}, at least {limits.min_points} are needed")


def _check_room(count: int, room: int) -> None:
    if count > room:
        raise CloudError(f"the objects before it have nearly all of the {MAX_OBJECT_POINTS} points of a message")


def _object(
    detection: Detection,
    index: int,
    xyz: Floats,
    rgb: Bytes | None,
    shape: tuple[Numbers, Box],
    *,
    here: Level,
    target: Target,
) -> ObjectCloud:
    centroid, box = shape
    return ObjectCloud(
        name=detection.name,
        label=detection.label,
        index=index,
        xyz=_octets(xyz.T.astype("<f4", order="C")),
        rgb=_octets(rgb),
        shape=_shape(centroid, box, here),
        in_target=None if target.from_points is None else _moved(target.from_points, centroid, box),
    )


def _octets(values: Floats | Bytes | None) -> memoryview:
    return memoryview(b"") if values is None else np.ascontiguousarray(values).reshape(-1).view(np.uint8).data


def _moved(transform: Numbers, centroid: Numbers, box: Box) -> Shape:
    """Return the shape in the target frame, whose z is what was up."""
    turn, offset = transform[:3, :3], transform[:3, 3]
    there = Box(turn @ box.centre + offset, box.size, turn @ box.along)
    return _shape(turn @ centroid + offset, there, ROS_LEVEL)


def _shape(centroid: Numbers, box: Box, level: Level) -> Shape:
    upright = UprightBox(
        centre=_three(box.centre), size=_three(box.size), yaw=level.yaw(box.along), up=_three(level.up)
    )
    return Shape(centroid=_three(centroid), box=upright)


def _three(vector: Numbers) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _transform(of: Header, target: Target) -> Transform | None:
    if target.from_points is None:
        return None
    x, y, z, w = quaternion_of(target.from_points).tolist()
    return Transform(
        frame_id=target.frame_id,
        child_frame_id=of.frame_id,
        stamp_ns=of.stamp_ns,
        translation=_three(target.from_points[:3, 3]),
        rotation=(x, y, z, w),
    )
