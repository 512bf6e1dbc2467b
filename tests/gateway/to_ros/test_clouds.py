from typing import Any

import msgspec
import numpy as np
import pytest

from gateway.ros1 import point_cloud
from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise
from gateway.to_ros.outputs import FIELDS, POINT, object_clouds
from schemas.objects import ObjectClouds
from schemas.points import VALUE_BYTES
from tests.schemas.results import cloud, clouds

SEEN = clouds(
    cloud((0.0, 0.5, 2.0), (0.25, 0.5, 2.0), rgb=bytes([1, 2, 3, 4, 5, 6]), label=2, index=4),
    cloud((1.0, 2.0, 3.0), rgb=bytes([255, 0, 128]), label=2**32 - 1, index=0),
)


def sent(seen: ObjectClouds, number: int = 1) -> Any:
    return deserialise(point_cloud.TYPE_NAME, object_clouds(seen, number))


def test_one_cloud_has_the_points_of_all_objects_and_whose_they_are() -> None:
    message = sent(SEEN)
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 3, 24, 72)
    assert (message.is_bigendian, message.is_dense) == (False, True)
    points = np.frombuffer(bytes(message.data), POINT)
    assert points["xyz"].tolist() == [[0, 0.5, 2], [0.25, 0.5, 2], [1, 2, 3]]
    assert points["label"].tolist() == [2, 2, 2**32 - 1]
    assert points["instance"].tolist() == [4, 4, 0]


def test_colours_are_packed_as_pcl_packs_them() -> None:
    packed = np.frombuffer(bytes(sent(SEEN).data), "<u4").reshape(3, 6)[:, 3]
    assert [hex(rgb) for rgb in packed] == ["0x10203", "0x40506", "0xff0080"]


def test_points_without_colour_are_white() -> None:
    packed = np.frombuffer(bytes(sent(clouds(cloud((0.0, 0.0, 1.0)))).data), "<u4")
    assert hex(packed[3]) == "0xffffff"


def test_the_fields_are_where_the_points_have_them() -> None:
    message = sent(SEEN)
    assert [(each.name, each.offset, each.datatype, each.count) for each in message.fields] == [
        ("x", 0, 7, 1),
        ("y", 4, 7, 1),
        ("z", 8, 7, 1),
        ("rgb", 12, 7, 1),
        ("label", 16, 6, 1),
        ("instance", 20, 6, 1),
    ]
    assert FIELDS[-1].offset + VALUE_BYTES[FIELDS[-1].datatype] == POINT.itemsize


def test_nothing_in_view_is_an_empty_cloud() -> None:
    message = sent(clouds())
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 0, 24, 0)
    assert (message.data.size, message.is_dense, len(message.fields)) == (0, True, 6)


def test_points_that_are_nowhere_are_not_said_to_be_dense() -> None:
    assert not sent(clouds(cloud((0.0, float("nan"), 1.0)))).is_dense


def test_stamp_and_frame_are_the_sensors_and_seq_is_the_topics() -> None:
    header = sent(SEEN, number=9).header
    assert (header.seq, header.stamp.sec, header.stamp.nanosec) == (9, 1_700_000_000, 0)
    assert header.frame_id == SEEN.header.frame_id


@pytest.mark.parametrize("fields", [{"stamp_ns": 2**32 * 10**9}])
def test_what_ros_cannot_say_is_refused(fields: dict[str, int]) -> None:
    late = msgspec.structs.replace(SEEN, header=msgspec.structs.replace(SEEN.header, **fields))
    with pytest.raises(MessageError, match="cannot serialise"):
        object_clouds(late, 1)
