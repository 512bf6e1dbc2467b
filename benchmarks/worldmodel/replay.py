"""Replays recorded rounds as the messages of a fleet whose localisation is off, by the distance service's own code."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.drives import SENSORS
from benchmarks.worldmodel.recording import RecordedImage, RecordedRound
from schemas.distances import CameraView, Distances
from services.distance.camera_views import Place, ViewMaker
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView, Frame, measure_apart
from services.distance.views import DepthLimits
from services.geometry.camera import CameraModel
from services.geometry.depth import Depth
from services.geometry.distortion import distortion_of

MAP: Final = "map"
LIMITS: Final = DepthLimits()
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PoseError:
    """Slowly drifting errors of localisation, an Ornstein-Uhlenbeck process in x, y and heading.

    metres, degrees: one standard deviation. seconds: in which they change.
    """

    metres: float = 0.05
    degrees: float = 1.0
    seconds: float = 30.0

    def drawn(self, rng: np.random.Generator, count: int, step_s: float) -> Floats:
        """Return (count, 3): metres, metres and radians, `step_s` apart."""
        keep = np.exp(-step_s / self.seconds)
        values = rng.normal(size=(count, 3))
        for row in range(1, count):
            values[row] = keep * values[row - 1] + np.sqrt(1 - keep**2) * values[row]
        return np.asarray(values * (self.metres, self.metres, np.radians(self.degrees)))


EXACT: Final = PoseError(0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """One image's messages at an instant, and what was recorded of it."""

    second: float
    image: RecordedImage
    view: CameraView
    distances: Distances


def replay(rounds: Sequence[RecordedRound], seconds: float, error: PoseError, seed: int) -> Iterator[Replayed]:
    """Yield the messages of all robots in the order of their stamps; each drives its round again and again."""
    hz = rounds[0].hz
    count = round(seconds * hz)
    rng = np.random.default_rng(seed)
    errors = [error.drawn(rng, count, 1 / hz) for _ in rounds]
    cameras = [_Camera() for _ in rounds]
    for step in range(count):
        for robot, of in enumerate(rounds):
            second = (step + robot / len(rounds)) / hz
            yield cameras[robot].messages(of.images[step % len(of.images)], second, step, errors[robot][step])


class _Camera:
    """The distance service's part that serves one camera."""

    def __init__(self) -> None:
        self._views = ViewMaker(Criteria(), "replay")
        made = SENSORS.color
        lens = distortion_of("plumb_bob", [0.0] * 5)
        self._model = CameraModel(made.height, made.width, made.fx, made.fy, made.cx, made.cy, 0.0, lens)

    def messages(self, image: RecordedImage, second: float, seq: int, error: Floats) -> Replayed:
        header = msgspec.structs.replace(image.detections.header, seq=seq, stamp_ns=round(second * 1e9) + 1)
        seen = msgspec.structs.replace(image.detections, header=header)
        pose = disturbed(np.array(image.pose), error)
        depth = DepthView(Depth(_metres(image.depth())), header.frame_id, self._model, [Frame(MAP, pose)])
        return Replayed(
            second=second,
            image=image,
            view=self._views.view(seen, depth, Place(MAP, pose)),
            distances=Distances(
                header=header,
                objects=measure_apart(seen.objects, depth, Criteria()),
                model="",
                worker="replay",
            ),
        )


def _metres(depth: NDArray[np.uint16]) -> NDArray[np.float32]:
    metres: NDArray[np.float32] = depth.astype(np.float32) / np.float32(1000)
    metres[(metres < LIMITS.nearest_m) | (metres > LIMITS.farthest_m)] = np.nan
    return metres


def disturbed(pose: Floats, error: Floats) -> Floats:
    """Return a pose (4 x 4) in the map turned about its own place by a heading, and moved by x and y."""
    x, y, turn = error
    cos, sin = np.cos(turn), np.sin(turn)
    made = pose.copy()
    made[:3, :3] = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ pose[:3, :3]
    made[:2, 3] += (x, y)
    return made
