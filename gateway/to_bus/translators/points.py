"""sensor_msgs/PointCloud2 to PointCloud."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.ros1.errors import MessageError
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.translators.stream_kind import NotOrganised, Repaired, stamped
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.points import MAX_FIELD_NAME, VALUE_BYTES, PointCloud, PointField, rgb_offsets


def point_cloud(message: Message, header: Header) -> PointCloud:
    """Translate a point cloud."""
    made, fault = read_cloud(message, header)
    if fault:
        raise Repaired(made, fault)
    return made


def read_cloud(message: Message, header: Header) -> tuple[PointCloud, str]:
    """Return a cloud, and in words how its layout was repaired, or an empty string."""
    found = ros_point_cloud.decode_point_cloud(message.data)
    row_step, data = _layout(found)
    made = PointCloud(
        header=stamped(header, found.stamp, found.frame_id),
        height=found.height,
        width=found.width,
        fields=[_field(field.name, field.offset, field.datatype, field.count) for field in found.fields],
        is_bigendian=found.is_bigendian,
        point_step=found.point_step,
        row_step=row_step,
        data=data,
        is_dense=found.is_dense,
    )
    return made, _fault(found) if (row_step, data.nbytes) != (found.row_step, found.data.nbytes) else ""


def _layout(cloud: ros_point_cloud.PointCloud) -> tuple[int, memoryview]:
    """Return the row stride in bytes, and the number of rows.

    Drivers that join, crop or hand on clouds leave `row_step` as it was, or spare bytes behind the points. ROS's own
    readers do not mind: they go from point to point, so in a cloud of one row they need no `row_step`. Where neither
    the number of points nor `row_step` settles the layout, both are returned as they were sent.
    """
    height, step, data = cloud.height, cloud.row_step, cloud.data
    row, size = cloud.width * cloud.point_step, cloud.data.nbytes
    fits = step >= row
    if not height or (fits and size == height * step):
        return step, data
    if size == height * row:
        return row, data
    if height == 1 and size > row:
        return row, data[:row]
    if fits and size > height * step:
        return step, data[: height * step]
    if fits and size >= (height - 1) * step + row:
        return row, memoryview(b"".join(data[at * step : at * step + row] for at in range(height)))
    return step, data


def _fault(cloud: ros_point_cloud.PointCloud) -> str:
    return (
        f"row_step is {cloud.row_step} bytes and data has {cloud.data.nbytes}, "
        f"for {cloud.height} x {cloud.width} points of {cloud.point_step} bytes"
    )


def _field(name: str, offset: int, datatype: int, count: int) -> PointField:
    if datatype not in VALUE_BYTES:
        raise SchemaError(f"field {name[:64]!r} has the unknown datatype {datatype}")
    if len(name) > MAX_FIELD_NAME:
        raise SchemaError(f"field with a name of {len(name)} characters")
    return PointField(name, offset, datatype, max(count, 1))  # some drivers set 0 for a single value


ENCODING: Final = "rgb8"
_NOBODYS: Final = Header(robot="nobody", boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=0)


def cloud_image(message: Message, header: Header) -> ImageFrame:
    """Translate the colours of an organised cloud to an image, with the cloud's stamp and frame."""
    cloud, fault = read_cloud(message, header)
    made = _image(cloud)
    if fault:
        raise Repaired(made, fault)
    return made


def shows_picture(message: Message) -> bool | None:
    """Return whether a cloud is an image; None if it has no points or cannot be read."""
    try:
        cloud, _ = read_cloud(message, _NOBODYS)
    except (MessageError, SchemaError):
        return None
    if not cloud.height * cloud.width:
        return None
    return min(cloud.height, cloud.width) > 1 and _colours(cloud) is not None


def _image(cloud: PointCloud) -> ImageFrame:
    if not cloud.height * cloud.width:
        raise SchemaError("a cloud without points is not an image")
    if min(cloud.height, cloud.width) < 2:
        raise NotOrganised(
            f"a cloud of {cloud.height} x {cloud.width} points is not an image: have its driver send organised clouds "
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
        raise NotOrganised("a cloud without colours is not an image: have its driver send them, or an image")
    pixels = np.empty((cloud.height, cloud.width, 3), np.uint8)
    for channel, offset in enumerate(offsets):
        pixels[..., channel] = np.ndarray(
            (cloud.height, cloud.width), np.uint8, cloud.data, offset, (cloud.row_step, cloud.point_step)
        )
    return pixels


def _colours(cloud: PointCloud) -> tuple[int, int, int] | None:
    return rgb_offsets(cloud.fields, is_bigendian=cloud.is_bigendian)
