"""Scenes of boxes on a floor, and what a camera sees of them, by casting rays."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.distances import REACHES, CameraView, DepthGrid, ViewedObject
from schemas.header import Header
from services.geometry.rotation import quaternion_of
from services.worldmodel.model import SiteModel
from services.worldmodel.placement import UNITS

Floats = NDArray[Any]

COLUMNS, ROWS, FINER = 32, 24, 4
HALF_VIEW = 0.6
FOCAL = float(COLUMNS / 2 / np.tan(HALF_VIEW))
NS = 1_000_000_000
FARTHEST_M = 10.0
LEAST_RAYS = 6
KNOWN_S = 11.0
"""When the first robot has seen all of a scene for twenty views, see `knowing`."""


@dataclass(frozen=True)
class Thing:
    """An upright box that stands at (x, y) with its lower side at z. size: length, width, height."""

    x: float
    y: float
    size: tuple[float, float, float] = (0.4, 0.4, 0.4)
    z: float = 0.0
    yaw: float = 0.0
    name: str = "box"

    @property
    def centre(self) -> Floats:
        return np.array([self.x, self.y, self.z + self.size[2] / 2])


FOUR = [Thing(3.0, -0.8), Thing(2.9, 0.9), Thing(3.2, 0.1), Thing(5.2, 1.6)]
TWO = [Thing(3.5, 0.6), Thing(4.2, -0.7)]


@dataclass(frozen=True)
class Camera:
    """A camera at (x, y, z) that looks along `yaw`, somewhat down. off: how far its robot is wrong (x, y, yaw)."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    z: float = 0.9
    pitch: float = -0.12
    robot: str = "r1"
    name: str = "front"
    off: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def pose(self, *, believed: bool) -> Floats:
        """Return the 4 x 4 pose of the optical frame in the map, as it is or as the robot believes."""
        dx, dy, dyaw = self.off if believed else (0.0, 0.0, 0.0)
        yaw = self.yaw + dyaw
        forward = np.array([np.cos(yaw) * np.cos(self.pitch), np.sin(yaw) * np.cos(self.pitch), np.sin(self.pitch)])
        right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        made = np.identity(4)
        made[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        made[:3, 3] = self.x + dx, self.y + dy, self.z
        return made


def view(
    things: Sequence[Thing],
    camera: Camera,
    at_s: float,
    *,
    blind_to: Collection[int] = (),
    extra: Sequence[ViewedObject] = (),
) -> CameraView:
    """Return what a camera sees. blind_to: numbers of things that the detector misses."""
    true, believed = camera.pose(believed=False), camera.pose(believed=True)
    depth, whose = _cast(things, true)
    rays = _rays()
    objects = []
    for number, thing in enumerate(things):
        hit = whose == number
        if hit.sum() >= LEAST_RAYS and number not in blind_to:
            points = rays[hit] * depth[hit, np.newaxis]
            placed = points @ believed[:3, :3].T + believed[:3, 3]
            objects.append(_viewed(thing.name, number, placed, hit, depth[hit]))
    return CameraView(
        header=Header(
            robot=camera.robot,
            camera=camera.name,
            boot_id="b",
            seq=round(at_s * 1000),
            stamp_ns=round(at_s * NS),
            frame_id="optical",
            received_ns=round(at_s * NS),
        ),
        frame_id="map",
        position=(float(believed[0, 3]), float(believed[1, 3]), float(believed[2, 3])),
        rotation=tuple(quaternion_of(believed).tolist()),
        grid=_grid(depth),
        objects=[*objects, *extra],
        model="m",
        worker="w",
    )


def watch(
    model: SiteModel, things: Sequence[Thing], cameras: Sequence[Camera], start_s: float, count: int
) -> list[str]:
    """Let a model take in what cameras see twice a second; return the kinds of changes."""
    kinds = []
    for step in range(count):
        for camera in cameras:
            at_s = start_s + step * 0.5
            kinds += [event.kind.value for event in model.take(view(things, camera, at_s), round(at_s * NS))]
    return kinds


def around(x: float, y: float, radius: float, count: int) -> list[Camera]:
    """Return cameras on a circle that look at its centre."""
    turns = np.arange(count) * 2 * np.pi / count
    return [
        Camera(x - radius * float(np.cos(t)), y - radius * float(np.sin(t)), float(t), robot=f"r{i}")
        for i, t in enumerate(turns)
    ]


def known(model: SiteModel) -> list[Thing]:
    """Return the confirmed objects of a model, by place."""
    objects = model.objects
    found = [
        Thing(
            float(objects.centre[row, 0]),
            float(objects.centre[row, 1]),
            (*objects.size[row].tolist(), float(objects.high[row] - objects.low[row])),
            float(objects.low[row]),
            float(objects.yaw[row]),
            model.classes.names[int(objects.cls[row])],
        )
        for row in objects.told_to_others().tolist()
    ]
    return sorted(found, key=lambda each: (round(2 * each.x), round(2 * each.y), each.z))


def moved(thing: Thing, x: float, y: float) -> Thing:
    return replace(thing, x=thing.x + x, y=thing.y + y)


def knowing(things: Sequence[Thing], robots: Sequence[str] = ("r1",)) -> SiteModel:
    model = SiteModel()
    watch(model, things, [Camera(robot=each) for each in robots], 1.0, 20)
    assert len(known(model)) == len(things)
    return model


def look_on(
    model: SiteModel,
    things: Sequence[Thing],
    camera: Camera,
    count: int,
    change: Callable[[CameraView], CameraView] = lambda each: each,
    *,
    start_s: float = KNOWN_S,
    drives: bool = False,
) -> list[str]:
    """Let a model take in what a camera sees twice a second, changed somehow; return the kinds of changes.

    drives: it goes to and fro, and every other view is of 1.2 m farther back.
    """
    back = replace(camera, x=camera.x - 1.2 * np.cos(camera.yaw), y=camera.y - 1.2 * np.sin(camera.yaw))
    views, kinds = [change(view(things, each, start_s)) for each in ((camera, back) if drives else (camera,))], []
    for step in range(count):
        at_ns, seen = round((start_s + step / 2) * NS), views[step % len(views)]
        header = msgspec.structs.replace(seen.header, stamp_ns=at_ns, received_ns=at_ns)
        kinds += [event.kind.value for event in model.take(msgspec.structs.replace(seen, header=header), at_ns)]
    return kinds


def doubted(model: SiteModel, robot: str) -> int:
    return int(model.offsets.doubted[model.robots.number(robot)])


def are_at(found: Sequence[Thing], things: Sequence[Thing]) -> bool:
    """Return whether each of some things is found once, within 0.25 m."""
    places = np.array([(each.x, each.y) for each in things])
    near = [np.flatnonzero(np.hypot(*(places - (each.x, each.y)).T) < 0.25).tolist() for each in found]
    return sorted(near) == [[number] for number in range(len(things))]


def without_depth(seen: CameraView) -> CameraView:
    """Return a view of a camera whose depth is 9.9 m everywhere, and so shows nothing."""
    assert seen.grid is not None
    far = memoryview(np.full(seen.grid.rows * seen.grid.columns, 9_900, "<u2").tobytes())
    return msgspec.structs.replace(
        seen, objects=[], grid=msgspec.structs.replace(seen.grid, near_mm=far, far_mm=far), unmeasured={}
    )


def _rays() -> Floats:
    columns, rows = (np.arange(size * FINER) + 0.5 for size in (COLUMNS, ROWS))
    x, y = np.meshgrid((columns / FINER - COLUMNS / 2) / FOCAL, (rows / FINER - ROWS / 2) / FOCAL)
    return np.stack([x, y, np.ones_like(x)], axis=2).reshape(-1, 3)


def _cast(things: Sequence[Thing], pose: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the depth of each ray, 0 for none, and the number of the thing that it hits, -1 for the floor."""
    rays = _rays() @ pose[:3, :3].T
    origin = pose[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[:, 2] < 0, -origin[2] / rays[:, 2], np.inf)
        whose = np.full(len(rays), -1)
        for number, thing in enumerate(things):
            cos, sin = np.cos(thing.yaw), np.sin(thing.yaw)
            turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
            start, along = turn @ (origin - thing.centre), rays @ turn.T
            half = np.array(thing.size) / 2
            first, second = (-half - start) / along, (half - start) / along
            entry = np.nanmax(np.minimum(first, second), axis=1)
            leave = np.nanmin(np.maximum(first, second), axis=1)
            hit = (entry < leave) & (entry > 0.05) & (entry < depth)
            depth, whose = np.where(hit, entry, depth), np.where(hit, number, whose)
    far = depth > FARTHEST_M
    return np.where(far, 0.0, depth), np.where(far, -1, whose)


def _viewed(name: str, index: int, points: Floats, hit: NDArray[np.bool_], depth: Floats) -> ViewedObject:
    middle = points.mean(axis=0)
    reach = ((points - middle)[:, :2] @ UNITS.T).max(axis=0)
    rows, columns = np.divmod(np.flatnonzero(hit), COLUMNS * FINER)
    x, y, z = middle.tolist()
    return ViewedObject(
        name=name,
        score=0.9,
        index=index,
        box=(
            float(columns.min()) / FINER,
            float(rows.min()) / FINER,
            float(columns.max() + 1) / FINER,
            float(rows.max() + 1) / FINER,
        ),
        depth_m=float(np.median(depth)),
        spread_m=float(depth.std()),
        at=(x, y, z),
        reach_mm=[round(max(each, 0) * 1000) for each in reach[:REACHES].tolist()],
        low_m=float(points[:, 2].min()),
        high_m=float(points[:, 2].max()),
    )


def _grid(depth: Floats) -> DepthGrid:
    cells = depth.reshape(ROWS, FINER, COLUMNS, FINER).swapaxes(1, 2).reshape(ROWS, COLUMNS, -1)
    ascending = np.sort(np.where(cells > 0, cells, FARTHEST_M), axis=2)
    some = (cells > 0).sum(axis=2) * 2 >= cells.shape[2]
    near, far = (np.where(some, ascending[..., index] * 1000, 0).astype("<u2") for index in (3, -4))
    return DepthGrid(
        columns=COLUMNS,
        rows=ROWS,
        fx=FOCAL,
        fy=FOCAL,
        cx=COLUMNS / 2,
        cy=ROWS / 2,
        near_mm=memoryview(near.tobytes()),
        far_mm=memoryview(far.tobytes()),
    )
