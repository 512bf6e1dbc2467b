"""sensor_msgs/PointCloud2 to PointCloud."""

from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.ros1.subscriber import Message
from gateway.translators.stream_kind import Repaired, stamped
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.points import MAX_FIELD_NAME, VALUE_BYTES, PointCloud, PointField


def point_cloud(message: Message, header: Header) -> PointCloud:
    """Translate a point cloud."""
    made, fault = read_cloud(message, header)
    if fault:
        raise Repaired(made, fault)
    return made


def read_cloud(message: Message, header: Header) -> tuple[PointCloud, str]:
    """Return a cloud, and in words why its layout is another than it says, or nothing."""
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
    """Return the bytes from row to row, and the rows.

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
    return PointField(name, offset, datatype, max(count, 1))  # some drivers say 0 for a single value
