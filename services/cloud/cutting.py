"""Turns detections and the points of their instant into ObjectClouds, with a reason for each missing one. Pure."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import msgspec
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo
from schemas.detections import Detections
from schemas.header import MAX_LABEL
from schemas.objects import MAX_OBJECT_POINTS, ObjectCloud, ObjectClouds
from schemas.points import PointCloud
from services.cloud.measuring import CloudLimits, measure
from services.cloud.objects import Target
from services.cloud.points import Points
from services.cloud.views import Instant, moves_of, target_of, view_of
from services.cloud.waiting import CloudJoiner
from services.geometry.errors import GeometryError

NO_ROOM: Final = "more points than fit in the message"


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """The input of cutting. Immutable, so any thread may use it.

    info: the colour camera's. moves: see `Instant`.
    """

    detections: Detections
    cloud: PointCloud
    info: CameraInfo | None
    moves: NDArray[Any] | str
    target: Target

    @classmethod
    def of(cls, detections: Detections, cloud: PointCloud, waiting: CloudJoiner, target_frame: str) -> "Job":
        """Snapshot the sensor data of the instant."""
        return cls(
            detections,
            cloud,
            waiting.info,
            moves_of(detections.header, cloud.header, waiting.tree),
            target_of(target_frame, cloud.header, waiting.tree),
        )


@dataclass(frozen=True, slots=True)
class Cut:
    """The result of cutting; unknown: why no object could be measured, or empty."""

    clouds: ObjectClouds
    unknown: str = ""


def cut(job: Job, limits: CloudLimits, worker: str) -> Cut:
    """Cut the objects out of the points."""
    try:
        points = Points.of(job.cloud)
        view = view_of(Instant(job.detections, points, job.cloud.header, job.info, job.moves))

        def measured(detections: Detections) -> ObjectClouds:
            return measure(detections, view, of=job.cloud.header, target=job.target, limits=limits, worker=worker)

        return Cut(apart(job.detections, measured))
    except GeometryError as error:
        return nothing(job.detections, str(error), worker)


def apart(detections: Detections, measured: Callable[[Detections], ObjectClouds]) -> ObjectClouds:
    """Measure detections; if one object fails, in whatever way, only that one has no cloud.

    Raises:
        GeometryError: none can be measured.
    """
    try:
        return measured(detections)
    except GeometryError:
        raise
    except Exception:  # noqa: BLE001 - which object it was, and why, is found out below
        return _each(detections, measured)


def _each(detections: Detections, measured: Callable[[Detections], ObjectClouds]) -> ObjectClouds:
    """Measure each of the detections by itself."""
    clouds: list[ObjectCloud] = []
    unmeasured: dict[int, str] = {}
    room = MAX_OBJECT_POINTS
    for index in range(len(detections.objects)):
        try:
            own = measured(_masked(detections, index))
        except Exception as error:  # noqa: BLE001 - said of the object
            unmeasured[index] = f"it failed: {error!r}"[:MAX_LABEL]
            continue
        points = sum(each.count for each in own.objects)
        if index in own.unmeasured or points > room:
            unmeasured[index] = own.unmeasured.get(index, NO_ROOM)
            continue
        clouds += own.objects
        room -= points
    return msgspec.structs.replace(measured(_masked(detections, None)), objects=clouds, unmeasured=unmeasured)


def _masked(detections: Detections, only: int | None) -> Detections:
    """Return detections of which at most one keeps its mask."""
    objects = [
        found if index == only else msgspec.structs.replace(found, mask=None)
        for index, found in enumerate(detections.objects)
    ]
    return msgspec.structs.replace(detections, objects=objects)


def nothing(detections: Detections, reason: str, worker: str) -> Cut:
    """Return a result in which no object has a cloud, with the reason."""
    clouds = ObjectClouds(
        header=detections.header,
        objects=[],
        model=detections.model,
        worker=worker,
        unmeasured=dict.fromkeys(range(len(detections.objects)), reason),
    )
    return Cut(clouds, reason)
