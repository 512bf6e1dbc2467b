"""Turns detections and points of the same instant into object clouds. Pure."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detections
from schemas.header import Header
from schemas.objects import MAX_OBJECT_POINTS, ObjectClouds
from services.cloud.cells import Seen
from services.cloud.objects import Target, objects_of
from services.cloud.outliers import crowded, own
from services.cloud.outlines import AT_ONCE, Candidates, CloudView, Cutout, Masked, RegisteredView
from services.cloud.points import CloudError, Floats, Indices, some
from services.cloud.upright_boxes import Boxes, Level, fit
from services.cloud.visible_size import shapes
from services.geometry.errors import MaskError
from services.geometry.masks import MEASURED_PIXELS, Window, decode_all

Numbers = NDArray[np.float64]

NO_MASK: Final = "its detection has no mask: the model does not segment"


@dataclass(frozen=True, slots=True)
class CloudLimits:
    """Limits on an object's points.

    min_points: fewer are no object. max_points: of more, so many are sent. voxel_m: the edge of cubes of each of which
    one point is sent, 0 to send all.
    """

    min_points: int = 10
    max_points: int = 100_000
    voxel_m: float = 0.0

    def limited(self, points: Cutout) -> Cutout:
        """Return the points to send."""
        if not self.voxel_m and len(points.at) <= self.max_points:
            return points
        return points.only(self._thinned(points.xyz))

    def _thinned(self, xyz: Floats) -> Indices:
        if not self.voxel_m or not xyz.size:
            return some(xyz.shape[1], self.max_points)
        cells = np.floor((xyz - xyz.min(axis=1, keepdims=True)) / np.float32(self.voxel_m)).astype(np.int64)
        _, kept = np.unique((cells[0] << 42) | (cells[1] << 21) | cells[2], return_index=True)
        kept.sort()
        return np.asarray(kept[some(len(kept), self.max_points)])


def measure(
    detections: Detections, view: CloudView, *, of: Header, target: Target, limits: CloudLimits, worker: str
) -> ObjectClouds:
    """Return the cloud of every detected object that has one, and the reasons for the others.

    of: the header of the points. view: them as the camera of the detections sees them.
    """
    level = Level.of(target.up(of.frame_id))
    unmeasured: dict[int, str] = {}
    masks = {index: Masked.of(window) for index, window in _masks(detections, unmeasured)}
    sent: dict[int, Cutout] = {}
    parts: list[tuple[Numbers, Boxes]] = []
    for found in _found(masks, view, limits, unmeasured):
        parts.append(_shapes({index: own for index, (own, _) in found.items()}, masks, view, level))
        sent.update((index, kept) for index, (_, kept) in found.items())
    objects = objects_of(detections.objects, sent, _joined(parts), level, target) if sent else []
    return ObjectClouds(
        header=msgspec.structs.replace(detections.header, stamp_ns=of.stamp_ns, frame_id=of.frame_id),
        objects=objects,
        model=detections.model,
        worker=worker,
        target=target.transform(of),
        unknown_target=target.unknown,
        unmeasured=unmeasured,
    )


def _shapes(
    found: Mapping[int, Cutout], masks: Mapping[int, Masked], view: CloudView, level: Level
) -> tuple[Numbers, Boxes]:
    """Return the centroids (n, 3) and boxes of objects, at least one, that consist of points."""
    if isinstance(view, RegisteredView) and view.factor == 1:
        width = view.points.shape[1]
        return shapes([Seen(masks[index], width, points.at, points.xyz) for index, points in found.items()], level)
    low, high, angles = zip(*(fit(points.xyz, level) for points in found.values()), strict=True)
    centroids = np.array([points.xyz.mean(axis=1, dtype=np.float64) for points in found.values()])
    return centroids, Boxes.between(np.array(low), np.array(high), np.array(angles), level)


def _joined(parts: Sequence[tuple[Numbers, Boxes]]) -> tuple[Numbers, Boxes]:
    """Return the centroids and boxes of all parts, one after another."""
    centroids, boxes = zip(*parts, strict=True)
    return np.concatenate(centroids), Boxes(
        centres=np.concatenate([each.centres for each in boxes]),
        sizes=np.concatenate([each.sizes for each in boxes]),
        along=np.concatenate([each.along for each in boxes]),
    )


def _masks(detections: Detections, unmeasured: dict[int, str]) -> Iterator[tuple[int, Window]]:
    """Decode the masks; failures go to `unmeasured`."""
    masks = {index: found.mask for index, found in enumerate(detections.objects) if found.mask is not None}
    unmeasured.update(dict.fromkeys(set(range(len(detections.objects))).difference(masks), NO_MASK))
    for index, window in zip(masks, decode_all(masks.values(), most=MEASURED_PIXELS), strict=True):
        if isinstance(window, MaskError):
            unmeasured[index] = str(window)
        else:
            yield index, window


def _found(
    masks: Mapping[int, Masked], view: CloudView, limits: CloudLimits, unmeasured: dict[int, str]
) -> Iterator[dict[int, tuple[Cutout, Cutout]]]:
    """Yield each object's own points, and those of them that are sent, for some objects at a time.

    Why there are none goes to `unmeasured`.
    """
    room = MAX_OBJECT_POINTS
    for group in _groups(zip(masks, view.within(list(masks.values())), strict=True), limits, unmeasured):
        found: dict[int, tuple[Cutout, Cutout]] = {}
        for index, points in zip(group, _isolated(list(group.values())), strict=True):
            kept = limits.limited(points)
            try:
                _check_enough(len(points.at), limits, "that stand out from what is behind it")
                _check_room(len(kept.at), room)
            except CloudError as error:
                unmeasured[index] = str(error)
                continue
            room -= len(kept.at)
            found[index] = points, kept
        if found:
            yield found


def _groups(
    candidates: Iterable[tuple[int, Candidates]], limits: CloudLimits, unmeasured: dict[int, str]
) -> Iterator[dict[int, Candidates]]:
    """Yield the objects with enough points, and their own points, some at a time."""
    group: dict[int, Candidates] = {}
    count = 0
    for index, each in candidates:
        try:
            _check_enough(len(each.depth), limits, "within its mask")
            _check_own(each)
        except CloudError as error:
            unmeasured[index] = str(error)
            continue
        group[index] = each
        count += len(each.depth)
        if count > AT_ONCE:
            yield group
            group, count = {}, 0
    if group:
        yield group


def _isolated(group: Sequence[Candidates]) -> Iterator[Cutout]:
    """Yield the foreground points of each mask, without outliers."""
    widths = np.array([each.width for each in group], np.float32)
    chosen = own([each.depth for each in group], widths, [each.around for each in group])
    kept = [_only(mine, each.points) for each, mine in zip(group, chosen, strict=True)]
    for points, mine in zip(kept, crowded([points.xyz for points in kept]), strict=True):
        yield _only(mine, points)


def _only(chosen: NDArray[np.bool_] | None, points: Cutout) -> Cutout:
    """Return the chosen points, None for all of them."""
    return points if chosen is None else points.only(np.flatnonzero(chosen))


def _check_enough(count: int, limits: CloudLimits, where: str) -> None:
    if count < limits.min_points:
        raise CloudError(f"{count} points {where}, at least {limits.min_points} are needed")


def _check_own(found: Candidates) -> None:
    if not found.own:
        count = len(found.depth)
        raise CloudError(f"{count} points within its mask, all from its surroundings: it returns none itself")


def _check_room(count: int, room: int) -> None:
    if count > room:
        raise CloudError(f"the objects before it use nearly all of the {MAX_OBJECT_POINTS} points of a message")
