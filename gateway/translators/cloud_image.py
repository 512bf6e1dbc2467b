"""sensor_msgs/PointCloud2 to ImageFrame: the picture that an organised cloud with colours is."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.ros1.errors import MessageError
from gateway.ros1.subscriber import Message
from gateway.translators.points import read_cloud
from gateway.translators.stream_kind import NotOrganised, Repaired
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.points import PointCloud, rgb_offsets

ENCODING: Final = "rgb8"
_NOBODYS: Final = Header(robot="nobody", boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=0)


def cloud_image(message: Message, header: Header) -> ImageFrame:
    """Translate the colours of a cloud's points, a pixel each, with the cloud's own stamp and frame."""
    cloud, fault = read_cloud(message, header)
    made = _image(cloud)
    if fault:
        raise Repaired(made, fault)
    return made


def shows_picture(message: Message) -> bool | None:
    """Return whether a cloud is a picture; None where it has no points or cannot be read, which tells nothing."""
    try:
        cloud, _ = read_cloud(message, _NOBODYS)
    except (MessageError, SchemaError):
        return None
    if not cloud.height * cloud.width:
        return None
    return min(cloud.height, cloud.width) > 1 and _colours(cloud) is not None


def _image(cloud: PointCloud) -> ImageFrame:
    if not cloud.height * cloud.width:
        raise SchemaError("a cloud without points is no picture")
    if min(cloud.height, cloud.width) < 2:
        raise NotOrganised(
            f"a cloud of {cloud.height} x {cloud.width} points is no picture: have its driver send organised clouds "
            "(realsense2_camera: ordered_pc), or an image"
        )
    pixels = _pixels(cloud)
    return ImageFrame(
        header=cloud.header,
        height=cloud.height,
        width=cloud.width,
        encoding=ENCODING,
        step=cloud.width * 3,
        data=pixels.reshape(-1).data,
    )


def _pixels(cloud: PointCloud) -> NDArray[np.uint8]:
    offsets = _colours(cloud)
    if offsets is None:
        raise NotOrganised("a cloud without colours is no picture: have its driver send them, or an image")
    pixels = np.empty((cloud.height, cloud.width, 3), np.uint8)
    for channel, offset in enumerate(offsets):
        pixels[..., channel] = np.ndarray(
            (cloud.height, cloud.width), np.uint8, cloud.data, offset, (cloud.row_step, cloud.point_step)
        )
    return pixels


def _colours(cloud: PointCloud) -> tuple[int, int, int] | None:
    return rgb_offsets(cloud.fields, is_bigendian=cloud.is_bigendian)
