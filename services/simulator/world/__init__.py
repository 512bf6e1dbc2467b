"""A procedural warehouse and its pictures: pure, and the same for the same seed."""

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.cuboids import BACKGROUND, CLASSES
from services.simulator.world.drive import Drive
from services.simulator.world.layout import generate
from services.simulator.world.render import Rendering, render
from services.simulator.world.scene import Scene
from services.simulator.world.sensor import Sensor, expose

__all__ = [
    "BACKGROUND",
    "CLASSES",
    "Camera",
    "Drive",
    "Pose",
    "Rendering",
    "Scene",
    "Sensor",
    "expose",
    "generate",
    "render",
]
