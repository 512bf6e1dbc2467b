"""sensor_msgs/CameraInfo to CameraInfo."""

from typing import Any, Final

import msgspec

from gateway.ros1.messages import deserialise
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.translators.stream_kind import label, stamp_of, stamped
from schemas.camera_info import MAX_DISTORTION, CameraInfo, Region
from schemas.errors import SchemaError
from schemas.header import Header

TYPE_NAME: Final = "sensor_msgs/CameraInfo"

UNTURNED: Final = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]


def camera_info(message: Message, header: Header) -> CameraInfo:
    """Translate a camera's calibration."""
    found: Any = deserialise(TYPE_NAME, message.data)
    if len(found.D) > MAX_DISTORTION:
        raise SchemaError(f"{len(found.D)} numbers of distortion, at most {MAX_DISTORTION} are carried")
    return CameraInfo(
        header=stamped(header, stamp_of(found.header), found.header.frame_id),
        height=found.height,
        width=found.width,
        distortion_model=label("distortion model", found.distortion_model),
        d=found.D.tolist(),
        k=found.K.tolist(),
        r=found.R.tolist(),
        p=found.P.tolist(),
        binning_x=found.binning_x,
        binning_y=found.binning_y,
        roi=_region(found.roi),
    )


def rectified_info(message: Message, header: Header) -> CameraInfo:
    """Translate the calibration of a rectified image to that of the ideal camera that P describes.

    ROS has one camera info for both: K and D are of the picture as the sensor took it. Where P has no focal length
    it stays as it is.
    """
    found = camera_info(message, header)
    if not (found.p[0] > 0 and found.p[5] > 0):
        return found
    k = [*found.p[0:3], *found.p[4:7], *found.p[8:11]]
    return msgspec.structs.replace(found, distortion_model="plumb_bob", d=[], k=k, r=UNTURNED)


def _region(roi: Any) -> Region:
    return Region(
        x_offset=roi.x_offset,
        y_offset=roi.y_offset,
        height=roi.height,
        width=roi.width,
        do_rectify=bool(roi.do_rectify),
    )
