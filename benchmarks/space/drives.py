"""Where the same objects are in the map, seen again and again from a robot that drives past them."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.space.matching import matched
from benchmarks.space.messages import STAMP_NS, depth_of, detections_of, header, info_of, transforms_of
from benchmarks.space.paths import DistancePath
from benchmarks.space.views import is_asked_for, view_from
from schemas.distances import ObjectDistance
from services.simulator.placement import BASE, COLOR_OPTICAL, MAP, ODOM, Placement, odometry_error, of_pose, rig
from services.simulator.world import Camera, Drive, Pose, Scene, generate
from services.training.evaluation.predictor import Predictor

FRAMES: Final = 10
APART_M: Final = 0.25
SPEED: Final = 0.75
"""Metres a second."""

PER_FRAME: Final = 6
"""How often between two frames the robot says where it is; never at the instant of a frame."""

PERIOD_NS: Final = round(APART_M / SPEED * 1e9)
LEAST_SIGHTINGS: Final = 4
PLACES: Final = (0.1, 0.6)
"""Where on their way robots are watched from on, in shares of it."""

Points = NDArray[np.float64]


def spreads(seed: int, predict: Predictor, frames: int = FRAMES) -> Iterator[tuple[float, float]]:
    """Yield how far the places of each object lie from their middle, and how far the true ones do: medians, metres.

    The true places are the middles of what is visible of it, which change as a robot drives by.
    """
    scene = generate(seed)
    drive = Drive.plan(scene)
    for start in PLACES:
        passing = Passing(scene, drive, start)
        for measured, true in passing.sightings(predict, frames):
            if len(measured) >= min(LEAST_SIGHTINGS, frames):
                yield _spread(measured), _spread(true)


@dataclass(frozen=True, slots=True, eq=False)
class Passing:
    """A stretch of a robot's drive. start: where it begins, as a share of the round."""

    scene: Scene
    drive: Drive
    start: float

    def sightings(self, predict: Predictor, frames: int) -> Iterable[tuple[list[Points], list[Points]]]:
        """Return the measured and the true places of each object in the map."""
        measured: defaultdict[int, list[Points]] = defaultdict(list)
        true: defaultdict[int, list[Points]] = defaultdict(list)
        path = self._path(frames)
        for number in range(frames):
            view, head = view_from(self.scene, self._pose(number)), header(COLOR_OPTICAL, _stamp(number))
            found = predict(view.image)
            objects = path.measure(detections_of(found, view.camera, head), depth_of(view.depth, head))
            for index, seen in matched(found, view.every_object).items():
                at = _in_map(objects[index])
                if at is not None and is_asked_for(seen):
                    measured[seen.instance].append(at)
                    true[seen.instance].append(seen.centroid_in_map)
        return [(places, true[instance]) for instance, places in measured.items()]

    def _pose(self, number: float) -> Pose:
        return self.drive.pose(self.start + number * APART_M / self.drive.length)

    def _path(self, frames: int) -> DistancePath:
        """Return a worker's camera that has heard what the robot says of its frames."""
        sensors = rig(self.drive.camera_height, self.drive.camera_pitch)
        path = DistancePath(info_of(Camera(), header(COLOR_OPTICAL)))
        path.sensed.transforms.take(transforms_of(sensors.static()), static=True)
        from_camera = np.linalg.inv(sensors.on_robot(COLOR_OPTICAL))
        odom = odometry_error(self.start)
        for step in range(-PER_FRAME, frames * PER_FRAME):
            number = (step + 0.5) / PER_FRAME
            robot: Placement = np.linalg.inv(odom) @ of_pose(self._pose(number)) @ from_camera
            said = transforms_of([(MAP, ODOM, odom), (ODOM, BASE, robot)], _stamp(number))
            path.sensed.transforms.take(said, static=False)
        return path


def _stamp(number: float) -> int:
    return STAMP_NS + round(number * PERIOD_NS)


def _in_map(found: ObjectDistance) -> Points | None:
    places = found.measured.places if found.measured is not None else []
    return next((np.array(place.at) for place in places if place.frame_id == MAP and place.at is not None), None)


def _spread(places: Sequence[Points]) -> float:
    return float(np.median(np.linalg.norm(places - np.median(places, axis=0), axis=1)))
