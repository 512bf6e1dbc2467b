"""A robot's drive as a loop of measurements, made on first use and cached within a memory limit. Pure."""

import sys
from collections.abc import Collection, Hashable
from dataclasses import dataclass
from enum import StrEnum, auto
from math import ceil
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from services.simulator.messages import ringed_points
from services.simulator.placement import COLOR_OPTICAL, DEPTH_OPTICAL, LIDAR, Placement, of_pose, rig, to_pose
from services.simulator.world import (
    Camera,
    ChangingWorld,
    DepthSensor,
    Drive,
    Lidar,
    Pose,
    Rendering,
    Scene,
    Sensor,
    as_16uc1,
    expose,
    generate,
    render,
    render_geometry,
    sense,
    turn,
)

Floats = NDArray[np.float32]
Image = NDArray[np.uint8]

EXPOSURE_S: Final = 0.008
"""Exposure time in a lit hall; at 30 images a second a D435's colour camera has no more than 33 ms."""
LONGEST_RAD: Final = float(np.radians(1.0))
"""The longest streak, seen from the camera: automatic exposure is shorter where the picture moves faster."""


def smeared(seen: Rendering, camera: Camera, opened: Pose, closed: Pose) -> Image:
    """Return RGB (h, w, 3) of a shutter open from one pose to another; `seen` is rendered halfway between them.

    Each pixel is smeared as its own surface moves. Where no streak is longer than a pixel, it is the picture seen.
    """
    across, down = streaks(seen.depth, camera, opened, closed)
    longest = float(cv2.magnitude(across, down).max())
    length = min(longest, LONGEST_RAD * camera.fx)
    if length <= 1:
        return seen.color
    count = ceil(length)
    places: Floats = np.indices(seen.depth.shape, np.float32)
    color = cv2.cvtColor(seen.color, cv2.COLOR_RGB2RGBA)  # four channels are moved in half the time of three
    light = np.zeros(color.shape, np.float32)
    for number in range(count):
        part = ((number + 0.5) / count - 0.5) * length / longest
        x, y = cv2.scaleAdd(across, part, places[1]), cv2.scaleAdd(down, part, places[0])
        cv2.accumulate(cv2.remap(color, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), light)
    mean = cv2.convertScaleAbs(light, alpha=1 / count)
    return np.asarray(cv2.cvtColor(mean, cv2.COLOR_RGBA2RGB), np.uint8)


def streaks(depth: Floats, camera: Camera, opened: Pose, closed: Pose) -> tuple[Floats, Floats]:
    """Return the motion in pixels, right and down, of each pixel's surface between two nearby poses.

    depth: metres along the optical axis, (h, w), 0 for what is too far away to have any.
    """
    turn = (closed.rotation - opened.rotation).T @ opened.rotation
    move = closed.rotation.T @ (opened.position - closed.position)
    x = (np.arange(camera.width, dtype=np.float32) - np.float32(camera.cx)) / np.float32(camera.fx)
    y = (np.arange(camera.height, dtype=np.float32)[:, None] - np.float32(camera.cy)) / np.float32(camera.fy)
    nearness = np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
    right, below, ahead = (
        turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] + move[axis] * nearness for axis in range(3)
    )
    return np.float32(camera.fx) * (right - x * ahead), np.float32(camera.fy) * (below - y * ahead)


if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

LEVEL: Final = 1


@dataclass(frozen=True, slots=True)
class _Kept:
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    data: bytes


class Store:
    """Caches arrays by key, up to `limit` bytes in all; arrays beyond that are not kept.

    First come, first kept: of a loop that does not fit a part is kept, where keeping the newest would keep nothing.
    """

    def __init__(self, limit: int) -> None:
        self.size = 0
        self.refused = 0
        self._limit = limit
        self._kept: dict[Hashable, _Kept] = {}

    def get(self, key: Hashable) -> NDArray[Any] | None:
        """Return a kept array, not writable; None when it is not kept."""
        kept = self._kept.get(key)
        return None if kept is None else np.frombuffer(zstd.decompress(kept.data), kept.dtype).reshape(kept.shape)

    def put(self, key: Hashable, array: NDArray[Any]) -> None:
        """Keep an array under a key that is not in use, if there is room."""
        data = zstd.compress(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data, LEVEL)
        if self.size + len(data) > self._limit:
            self.refused += 1
            return
        self._kept[key] = _Kept(array.shape, array.dtype, data)
        self.size += len(data)


Array = NDArray[Any]


class Part(StrEnum):
    """The measurements of an instant: RGB (h, w, 3) uint8; depth (h, w) uint16 mm; a lidar's points."""

    COLOR = auto()
    DEPTH = auto()
    SWEEP = auto()


@dataclass(frozen=True, slots=True)
class Equipment:
    """A robot's cameras. depth: None when it is registered to colour. metric: published in metres, not millimetres."""

    color: Camera
    depth: Camera | None = None
    metric: bool = False

    @property
    def aligned(self) -> bool:
        """Whether depth is registered to colour."""
        return self.depth is None

    @property
    def depth_camera(self) -> Camera:
        """The camera of the depth image."""
        return self.depth or self.color

    @property
    def depth_frame(self) -> str:
        """The frame of depth and of the coloured points."""
        return COLOR_OPTICAL if self.aligned else DEPTH_OPTICAL


class Film:
    """`frames` instants of a closed drive through the warehouse of `seed`: the same ones for the same arguments.

    hz: how many of them pass in a second, which is how fast the robot drives; 0 where it stands at each. round: number
    of the round through the warehouse, each another way. world: the same warehouse as it changes; its measurements are
    not kept, as none comes twice.
    """

    def __init__(
        self,
        seed: int,
        equipment: Equipment,
        frames: int,
        hz: float,
        store: Store,
        *,
        round: int = 0,  # noqa: A002
        world: ChangingWorld | None = None,
    ) -> None:
        self.seed = seed
        self.equipment = equipment
        self.frames = frames
        self.store = store
        self._scene = generate(seed) if world is None else world.still
        self.world = world
        self._way = (round,) if round else ()  # the first round's pictures are those of a seed alone
        self._drive = Drive.plan(self._scene, round)
        self.rig = rig(self._drive.camera_height, self._drive.camera_pitch)
        self._exposed = EXPOSURE_S * hz / frames if frames > 1 else 0.0  # how much of the round passes meanwhile
        self._from_camera = np.linalg.inv(self.rig.on_robot(COLOR_OPTICAL))

    def fraction(self, number: int) -> float:
        """The fraction of the round at an instant."""
        return number % self.frames / self.frames

    def robot(self, number: int) -> Placement:
        """The pose of `base_link` in the map."""
        return of_pose(self._drive.pose(self.fraction(number))) @ self._from_camera

    def measure(self, number: int, parts: Collection[Part], second: float = 0.0) -> dict[Part, Array]:
        """Return these parts of an instant; the drive repeats after the last. Arrays may be read-only.

        second: when that is, since the start, in a world that changes.
        """
        index = number % self.frames
        if self.world is not None:
            return self._made(self.world.scene(second), index, parts)
        kept = {part: self.store.get(self._key(index, part)) for part in parts}
        missing = [part for part, array in kept.items() if array is None]
        made = self._made(self._scene, index, missing) if missing else {}
        for part, array in made.items():
            self.store.put(self._key(index, part), array)
        return {part: array for part, array in {**kept, **made}.items() if array is not None}

    def _key(self, index: int, part: Part) -> Hashable:
        return self.seed, index, part, *self._way

    def _made(self, scene: Scene, index: int, parts: Collection[Part]) -> dict[Part, Array]:
        made: dict[Part, Array] = {}
        exact: NDArray[np.float32] | None = None
        if Part.COLOR in parts:
            seen = render(scene, self._drive.pose(self.fraction(index)), self.equipment.color)
            made[Part.COLOR] = expose(self._smeared(index, seen), Sensor(), self._rng(index))
            exact = seen.depth if self.equipment.aligned else None
        if Part.DEPTH in parts:
            made[Part.DEPTH] = self._depth(scene, index, exact)
        if Part.SWEEP in parts:
            made[Part.SWEEP] = ringed_points(turn(scene, self._pose(index, LIDAR), Lidar(), self._rng(index, 2)))
        return made

    def _smeared(self, index: int, seen: Rendering) -> Array:
        half, now = self._exposed / 2, self.fraction(index)
        opened, closed = self._drive.pose(now - half), self._drive.pose(now + half)
        return smeared(seen, self.equipment.color, opened, closed)

    def _depth(self, scene: Scene, index: int, exact: NDArray[np.float32] | None) -> Array:
        camera = self.equipment.depth_camera
        if exact is None:
            exact = render_geometry(scene, self._pose(index, self.equipment.depth_frame), camera).depth
        return as_16uc1(sense(exact, camera, DepthSensor(), self._rng(index, 1)))

    def _pose(self, index: int, frame: str) -> Pose:
        return to_pose(self.robot(index) @ self.rig.on_robot(frame))

    def _rng(self, *stream: int) -> np.random.Generator:
        return np.random.default_rng((self.seed, *stream, *self._way))
