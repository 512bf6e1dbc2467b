"""Receives the sensor data of a camera's robot."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable
from typing import Final, TypeVar

from bus import LATEST, QUEUE, Bus, Sample
from bus.api import Latest, Queue
from bus.sharing.work_counts import Tally
from schemas import codec
from schemas.camera_info import CameraInfo
from schemas.errors import SchemaError
from schemas.header import FrameOrder, Header
from schemas.image import ImageFrame
from schemas.keys import TF, TF_STATIC, CameraKey, RobotStreamKey, Stream
from schemas.transforms import Transforms
from services.distance.sensor_history import DEPTH_IMAGE, SensorHistory

DUPLICATE: Final = "the same detections again, or older ones"
REPLACED: Final = "replaced by newer detections"
UNJOINED: Final = "no depth image of the same instant"
FAILED: Final = "failed while measuring"
STAMPLESS: Final = "without a stamp"
TOO_MANY: Final = "too many at once"


class DetectionCounts(Tally):
    """Counts every image with detections once: measured, or dropped for a logged reason."""

    def __init__(self, camera: CameraKey) -> None:
        super().__init__(camera)
        self._order = FrameOrder()

    def is_new(self, header: Header) -> bool:
        """Return whether an image is newer than the last; at a take-over one of two workers may lag behind."""
        new = self._order.take(header, time.monotonic_ns())
        self.dropped[DUPLICATE] += not new
        return new

    def malformed(self, what: str) -> None:
        """Count a message that cannot be read."""
        self.dropped[f"malformed {what}"] += 1


log = logging.getLogger(__name__)

CALIBRATION: Final = "camera info"
TRANSFORMS: Final = "transforms"
DEPTHS_WAITING: Final = QUEUE(8, 128 << 20)
TRANSFORMS_WAITING: Final = QUEUE(1_000, 16 << 20)

H = TypeVar("H", ImageFrame, CameraInfo)


class SensorInput:
    """Fills `sensed` with data from one camera's robot. news: set whenever more has arrived."""

    def __init__(self, tally: DetectionCounts, sensed: SensorHistory) -> None:
        self._key = tally.camera
        self._tally = tally
        self._sensed = sensed
        self.news = asyncio.Event()

    async def run(self, bus: Bus) -> None:
        """Receive until cancelled."""
        camera, robot = self._key.stream, self._key.robot
        async with asyncio.TaskGroup() as group:
            for what, key, keep, accept in (
                (DEPTH_IMAGE, camera(Stream.DEPTH), DEPTHS_WAITING, self._depth),
                (CALIBRATION, camera(Stream.INFO), LATEST, self._info),
                (CALIBRATION, camera(Stream.DEPTH_INFO), LATEST, self._depth_info),
                (TRANSFORMS, str(RobotStreamKey(robot, TF)), TRANSFORMS_WAITING, self._tf),
                (TRANSFORMS, str(RobotStreamKey(robot, TF_STATIC)), TRANSFORMS_WAITING, self._tf_static),
            ):
                group.create_task(self._take(bus, what, key, keep, accept))

    def end(self) -> None:
        """Forget everything that belongs to an instant."""
        self._count()
        self._sensed.end()

    async def _take(
        self, bus: Bus, what: str, key: str, keep: Latest | Queue, accept: Callable[[Sample], None]
    ) -> None:
        lasting = accept not in (self._depth, self._tf)
        async with bus.subscribe(key, keep, history=lasting) as samples:
            async for sample in samples:
                if keep != LATEST:
                    self._tally.add(what, Counter({TOO_MANY: sample.replaced} if sample.replaced else {}))
                try:
                    accept(sample)
                except SchemaError as error:
                    self._tally.malformed(what)
                    log.warning("%s: %s left out: %s", self._key, what, error)
                self.news.set()

    def _depth(self, sample: Sample) -> None:
        frame = self._of_camera(ImageFrame, sample)
        if not frame.header.stamp_ns:
            self._tally.add(DEPTH_IMAGE, Counter({STAMPLESS: 1}))
            return
        self._sensed.depths.keep(frame.header.stamp_ns, frame, frame.data.nbytes)
        self._count()

    def _info(self, sample: Sample) -> None:
        self._sensed.info = self._of_camera(CameraInfo, sample)

    def _depth_info(self, sample: Sample) -> None:
        self._sensed.depth_info = self._of_camera(CameraInfo, sample)

    def _tf(self, sample: Sample) -> None:
        self._add(sample, TF)

    def _tf_static(self, sample: Sample) -> None:
        self._add(sample, TF_STATIC)

    def _add(self, sample: Sample, stream: str) -> None:
        said = codec.decode(Transforms, sample.payload, sample.encoding)
        codec.check_identity(said.header, RobotStreamKey(self._key.robot, stream))
        self._sensed.transforms.take(said, static=stream == TF_STATIC)
        self._count()

    def _count(self) -> None:
        self._tally.add(DEPTH_IMAGE, self._sensed.depths.dropped)
        self._tally.add(TRANSFORMS, self._sensed.transforms.rejected)

    def _of_camera(self, schema: type[H], sample: Sample) -> H:
        message = codec.decode(schema, sample.payload, sample.encoding)
        codec.check_identity(message.header, self._key)
        return message
