"""Brings a cloud into the view of the image that detections were made in. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo, is_calibrated
from schemas.detections import Detections
from schemas.header import Header
from schemas.space import MAX_COORDINATE_M
from services.cloud.objects import Target
from services.cloud.outlines import (
    NEAR_M,
    RING,
    Candidates,
    CloudView,
    Cutout,
    Masked,
    RegisteredView,
    factor_of,
    widths_of,
)
from services.cloud.points import FAR_M, CloudError, Floats, Indices, Points, some, usable
from services.geometry.camera import CameraModel
from services.geometry.distortion import Straight
from services.geometry.errors import GeometryError, TransformError
from services.geometry.foreground import has_own_depth
from services.geometry.masks import Window, surroundings
from services.geometry.transforms import TransformTree, between

FloatArray = NDArray[np.float64]
Selection = NDArray[np.bool_]

POINTS_A_CELL: Final = 4
SMALLEST_CELL: Final = 2
LARGEST_CELL: Final = 32
"""Sides, in pixels, of the cells of the picture in which what is in front hides what is behind."""

BEHIND: Final = 0.05
BEHIND_M: Final = 0.25
"""How much farther than the nearest point of its cell, relatively and in metres, a hidden point is."""


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Points in the image: indices in the cloud, positions before the camera (3, n), and pixels."""

    at: Indices
    xyz: Floats
    columns: NDArray[np.int32]
    rows: NDArray[np.int32]

    def only(self, kept: Indices) -> "_Seen":
        """Return a selection of the points."""
        return _Seen(self.at[kept], self.xyz.take(kept, axis=1), self.columns[kept], self.rows[kept])

    def depths(self, window: Window) -> Floats:
        """Return the depth of each pixel of a window; NaN where there is none."""
        rows, columns = self.rows - window.top, self.columns - window.left
        height, width = window.pixels.shape
        inside = np.flatnonzero((rows >= 0) & (rows < height) & (columns >= 0) & (columns < width))
        depths = np.full((height, width), np.nan, np.float32)
        depths[rows[inside], columns[inside]] = self.xyz[2].take(inside)
        return depths


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedView:
    """A cloud in view of a camera. camera_from_points: 4 x 4, moves points into the camera's optical frame."""

    points: Points
    camera: CameraModel
    camera_from_points: FloatArray

    def within(self, masks: Sequence[Masked]) -> Iterator[Candidates]:
        """See `CloudView.within`. Where masks overlap, the first one gets the points."""
        if not masks:
            return
        camera, xyz = self.camera, self.points.xyz()
        seen = _in_picture(camera, _moved(self.camera_from_points.astype(np.float32), xyz))
        side = _cell_side(camera, len(seen.at))
        owners = _owners([each.inner for each in masks], camera)
        seen = seen.only(np.flatnonzero(_near(masks, camera, side)[seen.rows // side, seen.columns // side]))
        seen = seen.only(np.flatnonzero(usable(xyz.take(seen.at, axis=1))))
        seen = seen.only(_in_front(seen, side, camera))
        owner = owners[seen.rows, seen.columns]
        order = np.argsort(owner, kind="stable")
        bounds = np.searchsorted(owner[order], np.arange(1, len(masks) + 2))
        owned = seen.only(order)
        xyz, rgb, widths = xyz.take(owned.at, axis=1), self.points.take(owned.at).rgb(), widths_of(owned.xyz, bounds)
        for each, (start, end), width in zip(masks, pairwise(bounds.tolist()), widths.tolist(), strict=True):
            points = Cutout(owned.at[start:end], xyz[:, start:end], None if rgb is None else rgb[start:end])
            mask = each.widened(camera.height, camera.width)
            depths = seen.depths(mask)
            around = depths[surroundings(mask, RING)]
            yield Candidates(points, owned.xyz[2, start:end], width, around[around > 0], has_own_depth(mask, depths))


def _moved(transform: Floats, xyz: Floats) -> Floats:
    """Return (3, n) points moved by a 4 x 4 transform; a matrix product of so few rows is slower."""
    x, y, z = xyz
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack([row[0] * x + row[1] * y + row[2] * z + row[3] for row in transform[:3]])


def _in_picture(camera: CameraModel, xyz: Floats) -> _Seen:
    columns, rows = (_straight if isinstance(camera.lens, Straight) else _bent)(camera, xyz)
    with np.errstate(invalid="ignore"):
        inside = (xyz[2] > NEAR_M) & (xyz[2] < FAR_M)
        for places, size in ((columns, camera.width), (rows, camera.height)):
            inside &= (places > -0.5) & (places < size - 0.5)
    at = np.flatnonzero(inside)
    return _Seen(at, xyz.take(at, axis=1), np.rint(columns[at]).astype(np.int32), np.rint(rows[at]).astype(np.int32))


def _straight(camera: CameraModel, xyz: Floats) -> tuple[Floats, Floats]:
    x, y, z = xyz
    with np.errstate(all="ignore"):
        x, y = x / z, y / z
        rows = y * np.float32(camera.fy) + np.float32(camera.cy)
        columns = x * np.float32(camera.fx) + np.float32(camera.cx)
        if camera.skew:
            columns += y * np.float32(camera.skew)
    return columns, rows


def _bent(camera: CameraModel, xyz: Floats) -> tuple[Floats, Floats]:
    """Project the points within the directions of the image's border."""
    across, down = np.arange(0, camera.width + 15, 16) - 0.5, np.arange(0, camera.height + 15, 16) - 0.5
    border = [(x, y) for x in across for y in (-0.5, camera.height - 0.5)]
    border += [(x, y) for y in down for x in (-0.5, camera.width - 0.5)]
    directions = camera.undistort(border).astype(np.float32)
    found = xyz[2] > NEAR_M
    for value, directed in zip(xyz[:2], directions.T, strict=True):
        if np.isfinite(directed).all():  # a fisheye's border may look where nothing is projected
            found &= (value >= directed.min() * xyz[2]) & (value <= directed.max() * xyz[2])
    pixels = np.full((2, len(found)), np.nan, np.float32)
    pixels[:, found] = camera.project(xyz[:, found].T).T
    return pixels[0], pixels[1]


def _owners(windows: Sequence[Window], camera: CameraModel) -> NDArray[np.int16]:
    """Return the object of each pixel of the image, counted from 1, and 0 for none."""
    owners = np.zeros((camera.height, camera.width), np.int16)
    for number in range(len(windows), 0, -1):
        window = windows[number - 1]
        owners[window.place][window.pixels] = number
    return owners


def _near(masks: Sequence[Masked], camera: CameraModel, side: int) -> Selection:
    """Return which cells of the image are in or around the windows of masks."""
    near = np.zeros((-(-camera.height // side), -(-camera.width // side)), np.bool_)
    for rows, columns in (each.mask.place for each in masks):
        near[
            max(0, rows.start - RING) // side : -(-(rows.stop + RING) // side),
            max(0, columns.start - RING) // side : -(-(columns.stop + RING) // side),
        ] = True
    return near


def _cell_side(camera: CameraModel, count: int) -> int:
    """Return the side of cells with POINTS_A_CELL on average, given the number of points in the image."""
    apart = np.sqrt(POINTS_A_CELL * camera.width * camera.height / max(1, count))
    return int(np.clip(np.ceil(apart), SMALLEST_CELL, LARGEST_CELL))


def _in_front(seen: _Seen, side: int, camera: CameraModel) -> Indices:
    """Return which points are not hidden by another in the same cell of the image."""
    depth, across = seen.xyz[2], -(-camera.width // side)
    cells = seen.rows // side * across + seen.columns // side
    nearest = np.full(across * -(-camera.height // side), np.inf, np.float32)
    np.minimum.at(nearest, cells, depth)
    return np.flatnonzero(depth <= nearest[cells] * np.float32(1 + BEHIND) + np.float32(BEHIND_M))


Numbers = NDArray[Any]

NO_INFO: Final = "no camera info of the colour image arrived, so no points can be projected into it"
FARTHEST_M: Final = MAX_COORDINATE_M / 2
"""Maximum distance of a target frame: nearby points then fit in messages."""

CHECKED: Final = 256
"""Number of points with a reading from which a cloud is judged to be registered."""

_STRAY_PIXELS: Final = 2.0
_SAME: Final = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """An image's detections and the points that belong to them. of: the header of the points.

    moves: 4 x 4, moves the points into the camera's optical frame, or why it is not known.
    """

    detections: Detections
    points: Points
    of: Header
    info: CameraInfo | None
    moves: Numbers | str


def view_of(instant: Instant) -> CloudView:
    """Return the points seen from the camera: pixel by pixel where registered to it, else projected.

    Raises:
        GeometryError: what is needed for that is not known.
    """
    moves = instant.moves
    if isinstance(moves, str):
        raise CloudError(f"points cannot be projected into the image: {moves}")
    factor = factor_of(instant.detections.height, instant.detections.width, instant.points)
    at_home = bool(factor) and bool(np.abs(moves - np.identity(4)).max() < _SAME)
    if at_home and not is_calibrated(instant.info):
        return RegisteredView(instant.points, factor)
    camera = _camera(instant)
    if at_home and _fits(instant.points, camera, factor):
        return RegisteredView(instant.points, factor)
    return ProjectedView(instant.points, camera, moves)


def moves_of(picture: Header, points: Header, tree: TransformTree) -> Numbers | str:
    """Return the transform from the points at their instant to the camera's frame at the image's, or why not."""
    try:
        return between(picture, points, tree)
    except TransformError as error:
        return str(error)


def target_of(frame_id: str, points: Header, tree: TransformTree) -> Target:
    """Return the pose of the points in the target frame; none if that has no name."""
    if not frame_id:
        return Target()
    try:
        from_points = tree.lookup(frame_id, points.frame_id, points.stamp_ns)
        if np.abs(from_points[:3, 3]).max() > FARTHEST_M:
            raise CloudError(f"{frame_id[:80]} is more than {FARTHEST_M:g} m away according to the transforms")
    except GeometryError as error:
        return Target(frame_id, unknown=str(error))
    return Target(frame_id, from_points)


def _camera(instant: Instant) -> CameraModel:
    if instant.info is None:
        raise CloudError(NO_INFO)
    camera = CameraModel.of(instant.info)
    camera.check_size(instant.detections.height, instant.detections.width)
    return camera


def _fits(points: Points, camera: CameraModel, factor: int) -> bool:
    """Return whether points lie along the rays of their pixels, as in a registered cloud."""
    at = some(points.shape[0] * points.shape[1], CHECKED)
    xyz = points.take(at).xyz()
    seen = np.flatnonzero(usable(xyz) & (xyz[2] > 0))
    if not len(seen):
        return True
    rows, columns = np.divmod(at[seen], points.shape[1])
    pixels = np.column_stack([columns, rows]) * factor + factor // 2
    off = np.abs(camera.project(xyz[:, seen].T) - pixels).max(axis=1)
    return 2 * int(np.count_nonzero(off <= _STRAY_PIXELS * factor)) >= len(off)
