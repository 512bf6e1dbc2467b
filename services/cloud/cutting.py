"""Detections and the points of their instant to ObjectClouds, with every reason why not. Pure."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from schemas.camera_info import CameraInfo
from schemas.detections import Detections
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from services.cloud.measuring import Limits, Target, measure
from services.cloud.points import Points
from services.cloud.views import Instant, moves_of, target_of, view_of
from services.cloud.waiting import Waiting
from services.geometry.errors import GeometryError


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What objects are cut out of. Nobody changes it any more, so any thread may do it.

    info: the colour camera's. moves: see `Instant`.
    """

    detections: Detections
    cloud: PointCloud
    info: CameraInfo | None
    moves: NDArray[Any] | str
    target: Target

    @classmethod
    def of(cls, detections: Detections, cloud: PointCloud, waiting: Waiting, target_frame: str) -> "Job":
        """Take what is known of the instant now."""
        return cls(
            detections,
            cloud,
            waiting.info,
            moves_of(detections.header, cloud.header, waiting.tree),
            target_of(target_frame, cloud.header, waiting.tree),
        )


@dataclass(frozen=True, slots=True)
class Cut:
    """What came of it; unknown: why no object could be measured, or empty."""

    clouds: ObjectClouds
    unknown: str = ""


def cut(job: Job, limits: Limits, worker: str) -> Cut:
    """Cut the objects out of the points."""
    try:
        points = Points.of(job.cloud)
        view = view_of(Instant(job.detections, points, job.cloud.header, job.info, job.moves))
        clouds = measure(
            job.detections, points, view, of=job.cloud.header, target=job.target, limits=limits, worker=worker
        )
    except GeometryError as error:
        return nothing(job.detections, str(error), worker)
    return Cut(clouds)


def nothing(detections: Detections, reason: str, worker: str) -> Cut:
    """Return that no object of a picture has a cloud, and why."""
    clouds = ObjectClouds(
        header=detections.header,
        objects=[],
        model=detections.model,
        worker=worker,
        unmeasured=dict.fromkeys(range(len(detections.objects)), reason),
    )
    return Cut(clouds, reason)
