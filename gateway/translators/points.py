"""sensor_msgs/PointCloud2 to PointCloud."""

from gateway.ros1.point_cloud import decode_point_cloud
from gateway.ros1.subscriber import Message
from gateway.translators.stream_kind import stamped
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.points import MAX_FIELD_NAME, VALUE_BYTES, PointCloud, PointField


def point_cloud(message: Message, header: Header) -> PointCloud:
    """Translate a point cloud."""
    found = decode_point_cloud(message.data)
    return PointCloud(
        header=stamped(header, found.stamp, found.frame_id),
        height=found.height,
        width=found.width,
        fields=[_field(field.name, field.offset, field.datatype, field.count) for field in found.fields],
        is_bigendian=found.is_bigendian,
        point_step=found.point_step,
        row_step=found.row_step or (found.data.nbytes if found.height == 1 else 0),  # some drivers leave it unset
        data=found.data,
        is_dense=found.is_dense,
    )


def _field(name: str, offset: int, datatype: int, count: int) -> PointField:
    if datatype not in VALUE_BYTES:
        raise SchemaError(f"field {name[:64]!r} has the unknown datatype {datatype}")
    if len(name) > MAX_FIELD_NAME:
        raise SchemaError(f"field with a name of {len(name)} characters")
    return PointField(name, offset, datatype, max(count, 1))  # some drivers say 0 for a single value
