"""What the workers of the distance and cloud services do with what they receive, without the bus."""

from collections.abc import Sequence
from typing import Final

from benchmarks.space.messages import cloud_of, depth_of, detections_of, header, info_of, transforms_of
from benchmarks.space.views import DEPTH_CAMERA, SpaceView
from bus.sharing.work_counts import Tally
from schemas.camera_info import CameraInfo
from schemas.detections import Detection, Detections
from schemas.distances import ObjectDistance
from schemas.image import ImageFrame
from schemas.keys import CameraKey
from schemas.objects import ObjectClouds
from schemas.points import PointCloud
from schemas.transforms import Transforms
from services.cloud.cutting import Job, cut
from services.cloud.measuring import CloudLimits
from services.cloud.waiting import CloudJoiner
from services.distance.depth_in_color_view import DepthLimits as Readings
from services.distance.depth_in_color_view import Views
from services.distance.depth_readings import Criteria
from services.distance.measuring import DepthView, measure, unknown
from services.distance.sensor_history import DEPTH_IMAGE, SensorHistory
from services.geometry.errors import GeometryError
from services.simulator.placement import BASE, COLOR_OPTICAL, DEPTH_OPTICAL, LIDAR, MAP
from services.worker.stamp_joiner import Joiner

TARGET: Final = BASE
CRITERIA: Final = Criteria()
LIMITS: Final = CloudLimits()


class DistancePath:
    """One camera at a distance worker, with its default settings."""

    def __init__(self, info: CameraInfo, depth_info: CameraInfo | None = None) -> None:
        self.sensed = SensorHistory((BASE, MAP), Joiner(DEPTH_IMAGE), info=info, depth_info=depth_info)
        self._views = Views(Readings())

    def measure(self, found: Detections, depth: ImageFrame) -> list[ObjectDistance]:
        """Join detections with depth and measure them."""
        self.sensed.depths.keep(depth.header.stamp_ns, depth, depth.data.nbytes)
        moment = self.sensed.at(found)
        if isinstance(moment.instant, str):
            return unknown(found.objects, moment.instant)
        try:
            image, model = self._views.view(moment.instant)
            return measure(found.objects, DepthView(image, found.header.frame_id, model, moment.frames), CRITERIA)
        except GeometryError as error:
            return unknown(found.objects, str(error))


class CloudPath:
    """One camera at a cloud worker, with its default settings."""

    def __init__(self, info: CameraInfo, transforms: Transforms) -> None:
        self._waiting = CloudJoiner(Tally(CameraKey("r1", "camera")), target=TARGET)
        self._waiting.info = info
        self._waiting.transforms(transforms, static=True)

    def cut(self, found: Detections, points: PointCloud) -> ObjectClouds:
        """Cut what was found out of points of the same instant."""
        return cut(Job.of(found, points, self._waiting, TARGET), LIMITS, "w").clouds


def distances(view: SpaceView, found: Sequence[Detection], *, registered: bool = True) -> list[ObjectDistance]:
    """Measure what was found, with depth registered to colour or as a camera beside it sends it."""
    info = info_of(view.camera, header(COLOR_OPTICAL))
    own_info = None if registered else info_of(DEPTH_CAMERA, header(DEPTH_OPTICAL))
    path = DistancePath(info, own_info)
    path.sensed.transforms.take(transforms_of(view.joints()), static=True)
    depth = depth_of(view.depth, info.header) if own_info is None else depth_of(view.own_depth, own_info.header)
    return path.measure(detections_of(found, view.camera, info.header), depth)


def clouds(view: SpaceView, found: Sequence[Detection], *, lidar: bool = False) -> ObjectClouds:
    """Cut what was found out of the organised cloud of registered depth, or out of a lidar's turn."""
    info = info_of(view.camera, header(COLOR_OPTICAL))
    points = cloud_of(view.sweep, header(LIDAR)) if lidar else cloud_of(view.points, info.header)
    path = CloudPath(info, transforms_of(view.joints()))
    return path.cut(detections_of(found, view.camera, info.header), points)
