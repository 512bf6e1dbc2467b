"""Renders an image of a scene, with exact depth and instances."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.cuboids import BACKGROUND, Floats
from services.simulator.world.scene import Scene
from services.simulator.world.shading import Shader
from services.simulator.world.textures import atlas
from services.simulator.world.visibility import Visibility, find_visible

FLOOR_TOP = 5


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """The output of an ideal depth camera, each (height, width).

    `depth` is metres along the optical axis and 0 where nothing is, `instances` are the scene's instance numbers and 0
    for the background.
    """

    depth: Floats
    instances: NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Rendering(Geometry):
    """The output of an ideal camera: `color` is RGB (height, width, 3)."""

    color: NDArray[np.uint8]


def render(scene: Scene, pose: Pose, camera: Camera) -> Rendering:
    """Render `scene` without any of a real sensor's faults."""
    visible = find_visible(scene.cuboids, pose, camera)
    shader = Shader(
        surfaces=scene.surfaces,
        floor=scene.floor,
        floor_face=FLOOR_TOP,
        atlas=atlas(),
        visible=visible,
        camera=camera,
        pose=pose,
    )
    geometry = _geometry(scene, visible)
    return Rendering(geometry.depth, geometry.instances, shader.image())


def render_geometry(scene: Scene, pose: Pose, camera: Camera) -> Geometry:
    """The depth and instances of `render`, without its colours."""
    return _geometry(scene, find_visible(scene.cuboids, pose, camera))


def _geometry(scene: Scene, visible: Visibility) -> Geometry:
    owners = np.append(scene.cuboids.instances[visible.faces // 6], np.int32(BACKGROUND))
    seen = visible.inverse_depth > 0
    depth = np.divide(1, visible.inverse_depth, out=np.zeros_like(visible.inverse_depth), where=seen)
    return Geometry(depth, owners[visible.slots])
