"""How long each part of a simulated robot's sensing takes, in the process that calls it."""

import time
from collections.abc import Callable, Iterator
from typing import Final, TypeVar

import cv2
import numpy as np

from services.simulator.film import EXPOSURE_S, smeared
from services.simulator.world import (
    Camera,
    DepthSensor,
    Drive,
    Lidar,
    Pose,
    Scene,
    Sensor,
    expose,
    generate,
    organised_cloud,
    render,
    render_geometry,
    sense,
    truth_of,
    turn,
)

PARTS: Final = ("render", "smear", "expose", "depth", "cloud", "geometry", "lidar", "truth", "visibility")
LEAST_SHARE: Final = 0.001
METRES_PER_SECOND: Final = 1.0
Times = dict[str, float]
Result = TypeVar("Result")


def measure(seeds: list[int], poses: int) -> list[Times]:
    """Return the milliseconds of processor time that each of `PARTS` took, for each view, and `wall` for a frame."""
    cv2.setNumThreads(1)
    found = []
    for index, (scene, way) in enumerate(_views([seeds[0], *seeds], poses)):
        times = _view(scene, *way)
        if index >= poses:  # the first scene comes twice: what is made once is made then
            found.append(times)
    return found


def _views(seeds: list[int], poses: int) -> Iterator[tuple[Scene, list[Pose]]]:
    """Yield scenes and where the camera is when its shutter opens, halfway, and when it closes."""
    for seed in seeds:
        scene = generate(seed)
        drive = Drive.plan(scene)
        half = METRES_PER_SECOND * EXPOSURE_S / drive.length / 2
        for index in range(poses):
            yield scene, [drive.pose(index / poses + moment) for moment in (-half, 0.0, half)]


def _view(scene: Scene, opened: Pose, pose: Pose, closed: Pose) -> Times:
    camera, rng, times = Camera(), np.random.default_rng(scene.seed), Times()

    def timed(part: str, work: Callable[[], Result]) -> Result:
        begun = time.process_time()
        result = work()
        times[part] = 1e3 * (time.process_time() - begun)
        return result

    begun = time.perf_counter()
    seen = timed("render", lambda: render(scene, pose, camera))
    color = timed("smear", lambda: smeared(seen, camera, opened, closed))
    timed("expose", lambda: expose(color, Sensor(), rng))
    depth = timed("depth", lambda: sense(seen.depth, camera, DepthSensor(), rng))
    times["wall"] = 1e3 * (time.perf_counter() - begun)
    timed("cloud", lambda: organised_cloud(depth, camera))
    timed("geometry", lambda: render_geometry(scene, pose, camera))
    x, y, _ = (float(value) for value in pose.position)
    timed("lidar", lambda: turn(scene, Pose.upright(x, y, 1.0, 0.0), Lidar(), rng))
    objects = timed("truth", lambda: truth_of(scene, seen, pose, camera))
    large = [each for each in objects if each.image_share >= LEAST_SHARE]
    timed("visibility", lambda: [each.visibility for each in large])
    return times
