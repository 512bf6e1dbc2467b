"""A procedural warehouse and its images, deterministic for a seed. Pure."""

from services.simulator.world.camera import Camera, Pose
from services.simulator.world.changing import Change, ChangeKind, ChangingWorld, Travel
from services.simulator.world.cuboids import BACKGROUND, CLASSES
from services.simulator.world.depth_sensor import DepthSensor, as_16uc1, as_32fc1, organised_cloud, sense
from services.simulator.world.drive import Drive
from services.simulator.world.layout import generate
from services.simulator.world.lidar import Lidar, Turn, turn
from services.simulator.world.render import Geometry, Rendering, render, render_geometry
from services.simulator.world.scene import Movable, Scene
from services.simulator.world.sensor import Sensor, expose
from services.simulator.world.truth import Box, PresentObject, SeenObject, present_in, truth, truth_of

__all__ = [
    "BACKGROUND",
    "CLASSES",
    "Box",
    "Camera",
    "Change",
    "ChangeKind",
    "ChangingWorld",
    "DepthSensor",
    "Drive",
    "Geometry",
    "Lidar",
    "Movable",
    "Pose",
    "PresentObject",
    "Rendering",
    "Scene",
    "SeenObject",
    "Sensor",
    "Travel",
    "Turn",
    "as_16uc1",
    "as_32fc1",
    "expose",
    "generate",
    "organised_cloud",
    "present_in",
    "render",
    "render_geometry",
    "sense",
    "truth",
    "truth_of",
    "turn",
]
