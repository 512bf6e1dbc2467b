"""Brings depth images into the colour camera's view. Pure."""

from dataclasses import dataclass
from typing import Any, Final

import msgspec
from numpy.typing import NDArray

from schemas.camera_info import CameraInfo, is_calibrated
from schemas.detections import Detections
from schemas.header import Header
from schemas.image import ImageFrame
from services.geometry.camera import CameraModel
from services.geometry.depth import Depth, read_depth
from services.geometry.errors import CalibrationError, GeometryError
from services.geometry.registration import Registration, is_registered
from services.geometry.transforms import frame_name

Transform = NDArray[Any]

NO_INFO: Final = "no camera info arrived"
_MODELS: Final = 4
_ANY: Final = Header(robot="any", boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=0)


@dataclass(frozen=True, slots=True)
class DepthLimits:
    """The range of valid depth, in metres."""

    nearest_m: float = 0.1
    farthest_m: float = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """The sensor data measured when an image was taken.

    info, depth_info: None where none arrived. color_from_depth: 4 x 4, from depth's optical frame at its stamp into the
    image's at the image's, or why it is not known.
    """

    detections: Detections
    depth: ImageFrame
    info: CameraInfo | None
    depth_info: CameraInfo | None
    color_from_depth: Transform | str


class Views:
    """Makes views of one camera; slow steps such as registration are prepared once per calibration."""

    def __init__(self, limits: DepthLimits) -> None:
        self._limits = limits
        self._models: dict[bytes, CameraModel] = {}
        self._key: tuple[CameraModel, CameraModel, bytes] | None = None
        self._registration: Registration | None = None

    def view(self, of: Instant) -> tuple[Depth, CameraModel | str]:
        """Return depth at each pixel of the image, and the image's camera or why it is unknown.

        Raises:
            GeometryError: depth cannot be read, or not be brought to the image.
        """
        image = read_depth(of.depth, nearest_m=self._limits.nearest_m, farthest_m=self._limits.farthest_m)
        size = (of.detections.height, of.detections.width)
        frames = {frame_name(each.header.frame_id) for each in (of.depth, of.detections)}
        alike = image.shape == size and len(frames) == 1
        infos = (of.info, of.depth_info)
        missing = not all(map(is_calibrated, infos))
        if alike:
            infos = _either(*infos), _either(*reversed(infos))
        color, depth = self._camera(infos[0], size), self._camera(infos[1], image.shape)
        if isinstance(color, CameraModel) and isinstance(depth, CameraModel):
            return self._registered(image, depth, color, of.color_from_depth), color
        if alike and missing:
            return image, color
        what, reason = ("colour", color) if isinstance(color, str) else ("depth", depth)
        raise CalibrationError(f"depth cannot be registered to colour: of {what} {reason}")

    def _camera(self, info: CameraInfo | None, size: tuple[int, ...]) -> CameraModel | str:
        if info is None:
            return NO_INFO
        try:
            model = self._model(info)
            model.check_size(*size)
        except CalibrationError as error:
            return str(error)
        return model

    def _model(self, info: CameraInfo) -> CameraModel:
        """Return the camera of a calibration, the same object while the calibration is unchanged."""
        calibration = msgspec.msgpack.encode(msgspec.structs.replace(info, header=_ANY))
        if calibration not in self._models:
            if len(self._models) >= _MODELS:
                self._models.clear()
            self._models[calibration] = CameraModel.of(info)
        return self._models[calibration]

    def _registered(
        self, image: Depth, depth: CameraModel, color: CameraModel, color_from_depth: Transform | str
    ) -> Depth:
        if isinstance(color_from_depth, str):
            raise GeometryError(f"depth cannot be registered to colour: {color_from_depth}")
        key = (depth, color, color_from_depth.tobytes())
        if key != self._key:
            fits = is_registered(depth, color, color_from_depth)
            self._registration = None if fits else Registration(depth, color, color_from_depth)
            self._key = key
        return image if self._registration is None else Depth(self._registration.apply(image.metres()))


def _either(own: CameraInfo | None, other: CameraInfo | None) -> CameraInfo | None:
    """Return a camera's calibration, or the other camera's where it is missing."""
    return other if is_calibrated(other) and not is_calibrated(own) else own or other
