"""Views of scenes that no training run uses: what a robot's sensors measure there, and what is true."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.messages import colored_points, metres, packed, ringed_points
from services.simulator.placement import (
    BASE,
    COLOR_OPTICAL,
    DEPTH_OPTICAL,
    LIDAR,
    MAP,
    Placement,
    Rig,
    of_pose,
    rig,
    to_pose,
)
from services.simulator.world import (
    Camera,
    DepthSensor,
    Lidar,
    Pose,
    Rendering,
    Scene,
    SeenObject,
    Sensor,
    as_16uc1,
    expose,
    generate,
    render,
    render_geometry,
    sense,
    truth_of,
    turn,
)
from services.simulator.world.clearance import Clearance
from services.training.dataset import holdout_seed
from services.training.viewpoints import draw_view

RUN: Final = 1
FIRST: Final = 200_000
"""The number, among a run's held-out scenes, of the first that is kept for these figures alone."""

LEAST_PIXELS: Final = 200
FARTHEST_M: Final = 8.0
DEPTH_CAMERA: Final = Camera.with_field_of_view(848, 480, 1.5)
"""Of depth that is not registered: wider than colour, and beside it."""

LIDAR_64: Final = Lidar.with_rings(64, float(np.radians(-25)), float(np.radians(15)))
Millimetres = NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class SpaceView:
    """A scene from where a robot's camera is; what is measured there is measured when it is asked for."""

    scene: Scene
    pose: Pose
    camera: Camera
    rendering: Rendering

    @cached_property
    def image(self) -> NDArray[np.uint8]:
        """What the colour camera sends, RGB."""
        return expose(self.rendering.color, Sensor.draw(self._rng(0)), self._rng(1))

    @cached_property
    def depth(self) -> Millimetres:
        """Depth that is registered to colour."""
        return as_16uc1(sense(self.rendering.depth, self.camera, DepthSensor(), self._rng(2)))

    @cached_property
    def own_depth(self) -> Millimetres:
        """Depth of a camera of its own, DEPTH_CAMERA."""
        exact = render_geometry(self.scene, self.pose_of(DEPTH_OPTICAL), DEPTH_CAMERA).depth
        return as_16uc1(sense(exact, DEPTH_CAMERA, DepthSensor(), self._rng(3)))

    @cached_property
    def points(self) -> NDArray[np.void]:
        """The organised cloud of the registered depth."""
        return colored_points(metres(self.depth), self.camera, packed(self.image))

    @cached_property
    def sweep(self) -> NDArray[np.void]:
        """A turn of a lidar of 64 rings; each ray without a return is a point that is not measured."""
        found = ringed_points(turn(self.scene, self.pose_of(LIDAR), LIDAR_64, self._rng(4)))
        rays = len(LIDAR_64.elevations) * LIDAR_64.columns
        whole = np.zeros((1, rays), found.dtype)
        for axis in "xyz":
            whole[axis] = np.nan
        whole[0, : found.shape[1]] = found[0]
        return whole

    @cached_property
    def every_object(self) -> tuple[SeenObject, ...]:
        """What is in view, however little of it."""
        return truth_of(self.scene, self.rendering, self.pose, self.camera)

    @cached_property
    def objects(self) -> list[SeenObject]:
        """The objects that figures are about."""
        return [each for each in self.every_object if is_asked_for(each)]

    @cached_property
    def rig(self) -> Rig:
        """Where the sensors are on the robot."""
        return rig(float(self.pose.position[2]), float(np.arcsin(self.pose.rotation[2, 2])))

    @cached_property
    def robot(self) -> Placement:
        """Where the robot is in the map."""
        return of_pose(self.pose) @ np.linalg.inv(self.rig.on_robot(COLOR_OPTICAL))

    def pose_of(self, frame: str) -> Pose:
        """Return where a sensor is."""
        return to_pose(self.robot @ self.rig.on_robot(frame))

    def joints(self) -> list[tuple[str, str, Placement]]:
        """Return everything that the robot says of its frames."""
        return [(MAP, BASE, self.robot), *self.rig.static()]

    def _rng(self, sensor: int) -> np.random.Generator:
        return np.random.default_rng([self.scene.seed, 6, 2, sensor])


def is_asked_for(seen: SeenObject) -> bool:
    """Return whether figures are about an object: LEAST_PIXELS of it are seen, within FARTHEST_M."""
    return seen.pixels >= LEAST_PIXELS and seen.depth_m <= FARTHEST_M


def seeds(count: int, first: int = FIRST) -> list[int]:
    """Return the scenes of that many views."""
    return [holdout_seed(RUN, first + index) for index in range(count)]


def view_of(seed: int) -> SpaceView:
    """Return the one view of a scene that is drawn as views of training scenes are."""
    scene = generate(seed)
    drawn = draw_view(scene, Clearance.of(scene), np.random.default_rng([seed, 6, 1]))
    return SpaceView(scene, drawn.pose, drawn.camera, drawn.rendering)


def view_from(scene: Scene, pose: Pose) -> SpaceView:
    """Return what the default camera sees."""
    camera = Camera()
    return SpaceView(scene, pose, camera, render(scene, pose, camera))
