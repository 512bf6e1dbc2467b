"""A robot's drive as a loop of measurements, each made when it is first needed and kept while there is room."""

from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum, auto
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.simulator.clouds import ringed_points
from services.simulator.placement import COLOR_OPTICAL, DEPTH_OPTICAL, LIDAR, Placement, of_pose, rig, to_pose
from services.simulator.shutter import EXPOSURE_S, smeared
from services.simulator.store import Store
from services.simulator.world import (
    Camera,
    DepthSensor,
    Drive,
    Lidar,
    Pose,
    Rendering,
    Sensor,
    as_16uc1,
    expose,
    generate,
    render,
    render_geometry,
    sense,
    turn,
)

Array = NDArray[Any]


class Part(StrEnum):
    """What is measured at an instant: RGB (h, w, 3) uint8; depth (h, w) uint16 mm; a lidar's points."""

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
        """The camera that depth is seen through."""
        return self.depth or self.color

    @property
    def depth_frame(self) -> str:
        """The frame of depth and of the coloured points."""
        return COLOR_OPTICAL if self.aligned else DEPTH_OPTICAL


class Film:
    """`frames` instants of a closed drive through the warehouse of `seed`: the same ones for the same arguments.

    hz: how many of them pass in a second, which is how fast the robot drives; 0 where it stands at each.
    """

    def __init__(self, seed: int, equipment: Equipment, frames: int, hz: float, store: Store) -> None:
        self.seed = seed
        self.equipment = equipment
        self.frames = frames
        self.store = store
        self._scene = generate(seed)
        self._drive = Drive.plan(self._scene)
        self.rig = rig(self._drive.camera_height, self._drive.camera_pitch)
        self._exposed = EXPOSURE_S * hz / frames if frames > 1 else 0.0  # how much of the round passes meanwhile
        self._from_camera = np.linalg.inv(self.rig.on_robot(COLOR_OPTICAL))

    def fraction(self, number: int) -> float:
        """How much of the round is behind the robot."""
        return number % self.frames / self.frames

    def robot(self, number: int) -> Placement:
        """Where `base_link` is in the map."""
        return of_pose(self._drive.pose(self.fraction(number))) @ self._from_camera

    def measure(self, number: int, parts: Collection[Part]) -> dict[Part, Array]:
        """Return these parts of an instant; it starts over after the last. Arrays may not be writable."""
        index = number % self.frames
        kept = {part: self.store.get((self.seed, index, part)) for part in parts}
        missing = [part for part, array in kept.items() if array is None]
        made = self._made(index, missing) if missing else {}
        for part, array in made.items():
            self.store.put((self.seed, index, part), array)
        return {part: array for part, array in {**kept, **made}.items() if array is not None}

    def _made(self, index: int, parts: Collection[Part]) -> dict[Part, Array]:
        made: dict[Part, Array] = {}
        exact: NDArray[np.float32] | None = None
        if Part.COLOR in parts:
            seen = render(self._scene, self._drive.pose(self.fraction(index)), self.equipment.color)
            made[Part.COLOR] = expose(self._smeared(index, seen), Sensor(), self._rng(index))
            exact = seen.depth if self.equipment.aligned else None
        if Part.DEPTH in parts:
            made[Part.DEPTH] = self._depth(index, exact)
        if Part.SWEEP in parts:
            made[Part.SWEEP] = ringed_points(turn(self._scene, self._pose(index, LIDAR), Lidar(), self._rng(index, 2)))
        return made

    def _smeared(self, index: int, seen: Rendering) -> Array:
        half, now = self._exposed / 2, self.fraction(index)
        opened, closed = self._drive.pose(now - half), self._drive.pose(now + half)
        return smeared(seen, self.equipment.color, opened, closed)

    def _depth(self, index: int, exact: NDArray[np.float32] | None) -> Array:
        camera = self.equipment.depth_camera
        if exact is None:
            exact = render_geometry(self._scene, self._pose(index, self.equipment.depth_frame), camera).depth
        return as_16uc1(sense(exact, camera, DepthSensor(), self._rng(index, 1)))

    def _pose(self, index: int, frame: str) -> Pose:
        return to_pose(self.robot(index) @ self.rig.on_robot(frame))

    def _rng(self, *stream: int) -> np.random.Generator:
        return np.random.default_rng((self.seed, *stream))
