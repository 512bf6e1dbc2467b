"""Replays recorded rounds as the messages of a fleet whose localisation is off, by the distance service's own code."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.drives import SENSORS
from benchmarks.worldmodel.recording import RecordedImage, RecordedRound
from schemas.distances import CameraView, Distances
from services.distance.camera_views import Place, ViewMaker
from services.distance.depth_in_color_view import DepthLimits
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView, Frame, measure_apart
from services.geometry.camera import CameraModel
from services.geometry.depth import Depth
from services.geometry.distortion import distortion_of
from services.simulator.localisation import Drift, Errors, Localisation, Lost, disturbed

MAP: Final = "map"
LIMITS: Final = DepthLimits()


EXACT: Final = Drift()


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """One image's message at an instant, and what was recorded of it. distances: makes the other message."""

    second: float
    image: RecordedImage
    view: CameraView
    distances: Callable[[], Distances]


def replay(
    rounds: Sequence[RecordedRound],
    seconds: float,
    drift: Drift,
    seed: int,
    *,
    lost: Sequence[Lost] = (),
    then: Sequence[RecordedImage] = (),
    since_s: float = 0.0,
) -> Iterator[Replayed]:
    """Yield the messages of all robots in the order of their stamps; each drives its round again and again.

    then: images of the same robots in turns that go on after so many seconds. since_s: of all that, when to begin.
    """
    hz = rounds[0].hz
    errors = [
        Localisation(drift, [each for each in lost if each.robot == of.robot], (seed, robot))
        for robot, of in enumerate(rounds)
    ]
    cameras = [ReplayedCamera() for _ in rounds]
    first = round(seconds * hz) * len(rounds)
    for number in range(round(since_s * hz) * len(rounds), first + len(then)):
        step, robot = divmod(number, len(rounds))
        second = (step + robot / len(rounds)) / hz
        images = rounds[robot].images
        image = images[step % len(images)] if number < first else then[number - first]
        yield cameras[robot].messages(image, second, step, errors[robot].error(second))


class ReplayedCamera:
    """The distance service's part that serves one camera."""

    def __init__(self) -> None:
        self._views = ViewMaker(Criteria(), "replay")
        made = SENSORS.color
        lens = distortion_of("plumb_bob", [0.0] * 5)
        self._model = CameraModel(made.height, made.width, made.fx, made.fy, made.cx, made.cy, 0.0, lens)

    def messages(self, image: RecordedImage, second: float, seq: int, error: Errors) -> Replayed:
        header = msgspec.structs.replace(image.detections.header, seq=seq, stamp_ns=round(second * 1e9) + 1)
        seen = msgspec.structs.replace(image.detections, header=header)
        pose = disturbed(np.array(image.pose), error)
        depth = DepthView(Depth(_metres(image.depth())), header.frame_id, self._model, [Frame(MAP, pose)])
        return Replayed(
            second=second,
            image=image,
            view=self._views.view(seen, depth, Place(MAP, pose)),
            distances=lambda: Distances(
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
