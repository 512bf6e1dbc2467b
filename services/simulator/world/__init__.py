"""A procedural warehouse and its images, deterministic for a seed. Pure."""

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.cuboids import BACKGROUND, CLASSES
from services.simulator.world.depth_sensor import DepthSensor, as_16uc1, as_32fc1, organised_cloud, sense
from services.simulator.world.drive import Drive
from services.simulator.world.layout import generate
from services.simulator.world.lidar import Lidar, Turn, turn
from services.simulator.world.render import Geometry, Rendering, render, render_geometry
from services.simulator.world.scene import Scene
from services.simulator.world.sensor import Sensor, expose
from services.simulator.world.truth import Box, SeenObject, truth, truth_of

__all__ = [
    "BACKGROUND",
    "CLASSES",
    "Box",
    "Camera",
    "DepthSensor",
    "Drive",
    "Geometry",
    "Lidar",
    "Pose",
    "Rendering",
    "Scene",
    "SeenObject",
    "Sensor",
    "Turn",
    "as_16uc1",
    "as_32fc1",
    "expose",
    "generate",
    "organised_cloud",
    "render",
    "render_geometry",
    "sense",
    "truth",
    "truth_of",
    "turn",
]
