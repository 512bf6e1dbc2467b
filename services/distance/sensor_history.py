"""Keeps recent data of one camera's robot: depth by stamp, calibrations, frames of reference. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from schemas.camera_info import CameraInfo
from schemas.detections import Detections
from schemas.header import Header
from schemas.image import ImageFrame
from services.distance.depth_in_color_view import Instant, Transform
from services.distance.measuring import Frame
from services.geometry.errors import TooNewError, TransformError
from services.geometry.transforms import TransformTree, between
from services.worker.stamp_joiner import Joiner, NoPartner

DEPTH_IMAGE: Final = "depth image"
NO_STAMP: Final = "the image has no stamp"


@dataclass(frozen=True, slots=True, eq=False)
class ImageContext:
    """Sensor data of an image's instant. instant: or why there is no depth. open: more may arrive."""

    instant: Instant | str
    frames: tuple[Frame, ...]
    open: bool


@dataclass(slots=True)
class SensorHistory:
    """Messages of one camera and its robot, joined with detections by stamp. frames: target frames of objects."""

    frames: Sequence[str]
    depths: Joiner[ImageFrame]
    transforms: TransformTree = field(default_factory=TransformTree)
    info: CameraInfo | None = None
    depth_info: CameraInfo | None = None

    def end(self) -> None:
        """Forget everything that belongs to an instant."""
        self.depths.flush()
        self.transforms.flush()

    def at(self, detections: Detections) -> ImageContext:
        """Return the sensor data of the instant of an image."""
        header = detections.header
        frames, frames_open = self._frames(header.frame_id, header.stamp_ns)
        if not header.stamp_ns:
            return ImageContext(NO_STAMP, frames, open=False)
        found = self.depths.find(header.stamp_ns)
        if isinstance(found, NoPartner):
            return ImageContext(found.reason, frames, open=not found.final)
        depth = found.item
        from_depth, early = self._lookup(header.frame_id, depth.header.frame_id, found.stamp_ns)
        if not isinstance(from_depth, str):
            from_depth = self._moved(from_depth, header, depth.header)
        instant = Instant(detections, depth, self.info, self.depth_info, from_depth)
        return ImageContext(instant, frames, open=frames_open or early or not found.final)

    def _frames(self, camera: str, stamp_ns: int) -> tuple[tuple[Frame, ...], bool]:
        found = [(name, *self._lookup(name, camera, stamp_ns)) for name in self.frames]
        return tuple(Frame(name, place) for name, place, _ in found), any(early for *_, early in found)

    def _moved(self, at_rest: Transform, image: Header, depth: Header) -> Transform:
        """Return the pose of the depth camera relative to the image's camera, as far as it is known now.

        Does not wait for transforms to arrive: on a standing robot they would make no difference.
        """
        try:
            return between(image, depth, self.transforms)
        except TransformError:
            return at_rest

    def _lookup(self, target: str, source: str, stamp_ns: int) -> tuple[Transform | str, bool]:
        """Return a transform or why it is unknown, and whether it may become known."""
        try:
            return self.transforms.lookup(target, source, stamp_ns), False
        except TransformError as error:
            return str(error), isinstance(error, TooNewError)
