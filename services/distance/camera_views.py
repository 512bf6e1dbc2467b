"""Makes camera views: where the visible surface of each object reaches to, and how far the camera saw. Pure."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from schemas.detections import Detection, Detections
from schemas.distances import REACHES, CameraView, DepthGrid, ViewedObject
from schemas.space import MAX_COORDINATE_M
from services.distance.depth_readings import Criteria, Picked, pick
from services.distance.measuring import DepthView, groups, own_readings
from services.geometry.camera import CameraModel
from services.geometry.errors import GeometryError
from services.geometry.masks import Window
from services.geometry.rotation import level_directions, quaternion_of

Floats = NDArray[Any]

COLUMNS: Final = 32
ROWS: Final = 24
SAMPLES: Final = 5
"""Readings of a cell, across and down."""

NEAR: Final = SAMPLES * SAMPLES // 5
"""Number of a cell's readings that are nearer than its `near_mm`, and farther than its `far_mm`."""

OUTLIERS: Final = 0.02
"""Share of an object's readings that may reach farther than it is said to."""

STEP: Final = 2
"""Every n-th reading of an object counts for its reach."""

MOST_MM: Final = 65_535
DIRECTIONS: Final = level_directions(REACHES)
"""Unit vectors of the directions of `reach_mm`, (REACHES, 2)."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """The camera's optical frame in the frame of a view. from_camera: 4 x 4, or why it is unknown.

    speed, turn: metres and radians a second.
    """

    frame_id: str
    from_camera: Floats | str
    speed: float = 0.0
    turn: float = 0.0


def motion(before: Floats, now: Floats, apart_s: float) -> tuple[float, float]:
    """Return metres and radians a second between two poses (4 x 4) so many seconds apart."""
    moved = float(np.linalg.norm(now[:3, 3] - before[:3, 3]))
    cosine = (np.trace(before[:3, :3].T @ now[:3, :3]) - 1) / 2
    return moved / apart_s, float(np.arccos(np.clip(cosine, -1, 1))) / apart_s


class ViewMaker:
    """Makes the views of one camera; where the readings of cells are is worked out once per calibration."""

    def __init__(self, criteria: Criteria, worker: str) -> None:
        self._criteria = criteria
        self._worker = worker
        self._camera: CameraModel | None = None
        self._pixels: NDArray[np.intp] | None = None

    def view(self, seen: Detections, depth: DepthView | str, place: Place) -> CameraView:
        """Return the view of an image. depth: why there is none of its instant, where that is so."""
        unlocated = place.from_camera if isinstance(place.from_camera, str) else _fault(place.from_camera)
        unseen = depth if isinstance(depth, str) else depth.camera if isinstance(depth.camera, str) else ""
        if unlocated or isinstance(depth, str) or isinstance(depth.camera, str):
            return self._blind(seen, place, unlocated, unseen)
        try:
            depth.camera.check_size(*depth.depth.shape)
            grid = self._grid(depth, depth.camera)
        except GeometryError as error:
            return self._blind(seen, place, unlocated, str(error))
        objects = list(_viewed(seen.objects, depth, depth.camera, self._criteria, np.asarray(place.from_camera)))
        return self._message(seen, place, grid=grid, objects=objects)

    def _blind(self, seen: Detections, place: Place, unlocated: str, unseen: str) -> CameraView:
        return self._message(seen, place, unlocated=unlocated, unseen=unseen)

    def _message(
        self,
        seen: Detections,
        place: Place,
        *,
        objects: Sequence[ViewedObject] = (),
        grid: DepthGrid | None = None,
        unlocated: str = "",
        unseen: str = "",
    ) -> CameraView:
        measured = {each.index for each in objects}
        position, rotation = (None, (0.0, 0.0, 0.0, 1.0)) if unlocated else _pose(np.asarray(place.from_camera))
        return CameraView(
            header=seen.header,
            frame_id=place.frame_id,
            position=position,
            rotation=rotation,
            speed=place.speed,
            turn=place.turn,
            unlocated=unlocated[:256],
            grid=grid,
            unseen=unseen[:256],
            objects=list(objects),
            unmeasured=Counter(each.name for index, each in enumerate(seen.objects) if index not in measured),
            model=seen.model,
            worker=self._worker,
            spans=seen.spans,
        )

    def _grid(self, view: DepthView, camera: CameraModel) -> DepthGrid:
        if camera is not self._camera or self._pixels is None:
            self._camera, self._pixels = camera, _pixels_of(camera)
        readings = np.where(self._pixels >= 0, view.depth.metres_of(self._pixels), np.nan)
        near, far = _quantiles(readings)
        across, down = COLUMNS / camera.width, ROWS / camera.height
        return DepthGrid(
            columns=COLUMNS,
            rows=ROWS,
            fx=camera.fx * across,
            fy=camera.fy * down,
            cx=(camera.cx + 0.5) * across,
            cy=(camera.cy + 0.5) * down,
            near_mm=memoryview(near.astype("<u2").tobytes()),
            far_mm=memoryview(far.astype("<u2").tobytes()),
        )


def _fault(from_camera: Floats) -> str:
    far = not np.isfinite(from_camera).all() or np.abs(from_camera[:3, 3]).max() > MAX_COORDINATE_M
    return "farther away than any place according to the transforms" if far else ""


def _pose(from_camera: Floats) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    x, y, z = from_camera[:3, 3].tolist()
    qx, qy, qz, qw = quaternion_of(from_camera).tolist()
    return (x, y, z), (qx, qy, qz, qw)


def _pixels_of(camera: CameraModel) -> NDArray[np.intp]:
    """Return the flat pixels of each cell's readings, (cells, SAMPLES ** 2); -1 outside of the image.

    Cells divide the image of a pinhole camera; where the real lens bends, they are looked up through it.
    """
    columns, rows = (
        (np.arange(count * SAMPLES) + 0.5) * (size / (count * SAMPLES)) - 0.5
        for count, size in ((COLUMNS, camera.width), (ROWS, camera.height))
    )
    x, y = np.meshgrid((columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy)
    u, v = camera.pixels_of(x, y, np.ones_like(x))
    u, v = np.rint(np.nan_to_num(u, nan=-1.0)), np.rint(np.nan_to_num(v, nan=-1.0))
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    flat = np.where(inside, v * camera.width + u, -1).astype(np.intp)
    return flat.reshape(ROWS, SAMPLES, COLUMNS, SAMPLES).swapaxes(1, 2).reshape(ROWS * COLUMNS, -1)


def _quantiles(readings: Floats) -> tuple[Floats, Floats]:
    """Return millimetres that NEAR of each row's readings are nearer, and farther, than; 0 where half are missing."""
    counts = np.isfinite(readings).sum(axis=1)
    ascending = np.sort(readings, axis=1)  # NaN last
    rows, skipped = np.arange(len(readings)), counts * NEAR // readings.shape[1]
    known = 2 * counts >= readings.shape[1]
    near = ascending[rows, skipped]
    far = ascending[rows, np.maximum(counts - 1 - skipped, 0)]
    return tuple(  # type: ignore[return-value]
        np.where(known, np.clip(np.nan_to_num(each) * 1000, 1, MOST_MM), 0) for each in (near, far)
    )


def _viewed(
    objects: Sequence[Detection], view: DepthView, camera: CameraModel, criteria: Criteria, from_camera: Floats
) -> Iterator[ViewedObject]:
    for windows in groups(objects, {}):
        yield from _of_windows(
            objects, windows, pick(list(windows.values()), view.depth, criteria), camera, from_camera
        )


def _of_windows(
    objects: Sequence[Detection], windows: dict[int, Window], picked: Picked, camera: CameraModel, from_camera: Floats
) -> Iterator[ViewedObject]:
    if not len(picked.rows):
        return
    axial, spread, solid = own_readings(picked)
    points, solid = _points(picked, solid, camera, from_camera)
    shapes = [each.tolist() for each in _shapes(points, solid)]
    cells = (COLUMNS / camera.width, ROWS / camera.height) * 2
    indices = list(windows)
    for row, depth_m, spread_m, at, reach, low, high in zip(
        picked.rows.tolist(), axial.tolist(), spread.tolist(), *shapes, strict=True
    ):
        found = objects[indices[row]]
        if not all(map(np.isfinite, at)):
            continue
        x1, y1, x2, y2 = (edge * scale for edge, scale in zip(_corners(found), cells, strict=True))
        yield ViewedObject(
            name=found.name,
            score=found.score,
            index=indices[row],
            track=found.track,
            box=(x1, y1, x2, y2),
            depth_m=depth_m,
            spread_m=spread_m,
            at=tuple(at),
            reach_mm=reach,
            low_m=low,
            high_m=high,
        )


def _corners(found: Detection) -> tuple[float, float, float, float]:
    """Return the corners of a detection's box in pixels."""
    return found.box.x1, found.box.y1, found.box.x2, found.box.y2


def _points(
    picked: Picked, solid: NDArray[np.bool_], camera: CameraModel, from_camera: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return some of n objects' readings in the view's frame, (n, m, 3), and which of them count."""
    z, at, solid = picked.z[:, ::STEP], picked.at[:, ::STEP], solid[:, ::STEP]
    x, y = camera.rays_of(at)
    points = np.stack([x * z, y * z, z], axis=2).astype(np.float64)
    solid = solid & np.isfinite(points).all(axis=2)
    return np.where(solid[..., np.newaxis], points, 0.0) @ from_camera[:3, :3].T + from_camera[:3, 3], solid


def _shapes(points: Floats, solid: NDArray[np.bool_]) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the middle of each object's points (n, 3), reaches (n, REACHES) in mm, lowest and highest z (n,)."""
    counts = solid.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        middles = np.einsum("nmk,nm->nk", points, solid) / counts[:, np.newaxis]
    away = points - middles[:, np.newaxis]
    along = np.concatenate([away[..., :2] @ DIRECTIONS.T, away[..., 2:], -away[..., 2:]], axis=2)
    along = np.where(solid[..., np.newaxis], along, -np.inf)
    along.sort(axis=1)
    stray = along.shape[1] - 1 - (counts * OUTLIERS).astype(np.intp)
    reach = along[np.arange(len(along)), stray]
    reach = np.where(np.isfinite(reach), np.maximum(reach, 0), 0)
    millimetres = np.rint(np.minimum(reach[:, :REACHES], 1e6) * 1000).astype(np.int64)
    return middles, millimetres, middles[:, 2] - reach[:, REACHES + 1], middles[:, 2] + reach[:, REACHES]
