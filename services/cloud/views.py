"""How a cloud lies to the pictures that detections are of. Pure."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo, is_calibrated
from schemas.detections import Detections
from schemas.header import Header
from schemas.space import MAX_COORDINATE_M
from services.cloud.errors import CloudError
from services.cloud.objects import Target
from services.cloud.outlines import RegisteredView, View, factor_of
from services.cloud.points import Points, usable
from services.cloud.projection import ProjectedView
from services.cloud.sampling import some
from services.geometry.camera import CameraModel
from services.geometry.errors import GeometryError, TransformError
from services.geometry.motion import between
from services.geometry.transforms import TransformTree

Numbers = NDArray[Any]

NO_INFO: Final = "no camera info of the colour image arrived, so no points can be projected into it"
FARTHEST_M: Final = MAX_COORDINATE_M / 2
"""How far away a target frame may be: what is near the points is then within what messages carry."""

CHECKED: Final = 256
"""So many points, those of them with a reading, say whether a cloud is registered."""

_STRAY_PIXELS: Final = 2.0
_SAME: Final = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """A picture's detections, and the points that belong to them. of: the header of the points.

    moves: 4 x 4, moves the points into the camera's optical frame, or why it is not known.
    """

    detections: Detections
    points: Points
    of: Header
    info: CameraInfo | None
    moves: Numbers | str


def view_of(instant: Instant) -> View:
    """Return the points as the camera sees them: pixel by pixel where they are registered to it, else projected.

    Raises:
        GeometryError: what is needed for that is not known.
    """
    moves = instant.moves
    if isinstance(moves, str):
        raise CloudError(f"points cannot be brought to the picture: {moves}")
    factor = factor_of(instant.detections.height, instant.detections.width, instant.points)
    at_home = bool(factor) and bool(np.abs(moves - np.identity(4)).max() < _SAME)
    if at_home and not is_calibrated(instant.info):
        return RegisteredView(instant.points, factor)
    camera = _camera(instant)
    if at_home and _fits(instant.points, camera, factor):
        return RegisteredView(instant.points, factor)
    return ProjectedView(instant.points, camera, moves)


def moves_of(picture: Header, points: Header, tree: TransformTree) -> Numbers | str:
    """Return the transform that moves points of their instant into the camera's frame at the picture's, or why not."""
    try:
        return between(picture, points, tree)
    except TransformError as error:
        return str(error)


def target_of(frame_id: str, points: Header, tree: TransformTree) -> Target:
    """Return where points are in the target frame, which is none if it has no name."""
    if not frame_id:
        return Target()
    try:
        from_points = tree.lookup(frame_id, points.frame_id, points.stamp_ns)
        if np.abs(from_points[:3, 3]).max() > FARTHEST_M:
            raise CloudError(f"{frame_id[:80]} is more than {FARTHEST_M:g} m away by the transforms")
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
    """Return whether points lie where their pixels look, as a registered cloud's do."""
    at = some(points.shape[0] * points.shape[1], CHECKED)
    xyz = points.take(at).xyz()
    seen = np.flatnonzero(usable(xyz) & (xyz[2] > 0))
    if not len(seen):
        return True
    rows, columns = np.divmod(at[seen], points.shape[1])
    pixels = np.column_stack([columns, rows]) * factor + factor // 2
    off = np.abs(camera.project(xyz[:, seen].T) - pixels).max(axis=1)
    return 2 * int(np.count_nonzero(off <= _STRAY_PIXELS * factor)) >= len(off)
