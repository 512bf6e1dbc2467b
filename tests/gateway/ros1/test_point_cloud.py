from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gateway.ros1.errors import MessageError
from gateway.ros1.messages import deserialise, new_message, serialise
from gateway.ros1.point_cloud import MAX_FIELDS, TYPE_NAME, PointField, decode_point_cloud, encode_point_cloud
from gateway.ros1.wire.text import MAX_TEXT_BYTES
from tests.gateway.sensing import STAMP_NS, point_cloud

MESSAGE = bytes(point_cloud().data)


def test_agrees_with_rosbags() -> None:
    theirs, ours = deserialise(TYPE_NAME, MESSAGE), decode_point_cloud(MESSAGE)
    assert (ours.stamp, ours.frame_id) == (STAMP_NS, theirs.header.frame_id)
    assert (ours.height, ours.width) == (theirs.height, theirs.width)
    assert ours.fields == (PointField("x", 0, 7, 1), PointField("ring", 4, 4, 0))
    assert (ours.point_step, ours.row_step) == (theirs.point_step, theirs.row_step)
    assert (ours.is_bigendian, ours.is_dense) == (theirs.is_bigendian, theirs.is_dense)
    assert np.array_equal(np.frombuffer(ours.data, np.uint8), theirs.data)


def test_points_are_a_view_into_the_message() -> None:
    message = bytearray(MESSAGE)
    cloud = decode_point_cloud(message)
    message[-2] = 255
    assert cloud.data[-1] == 255


@pytest.mark.parametrize("size", range(len(MESSAGE)))
def test_message_cut_off_anywhere_is_refused(size: int) -> None:
    with pytest.raises(MessageError):
        decode_point_cloud(MESSAGE[:size])


def test_bytes_after_the_message_are_refused() -> None:
    with pytest.raises(MessageError, match="announces 48 bytes of points and holds 49"):
        decode_point_cloud(MESSAGE + b"x")


def test_most_fields_and_the_longest_name_and_one_more() -> None:
    def cloud(fields: int, name: int) -> bytes:
        field = new_message("sensor_msgs/PointField", name="x" * name, offset=0, datatype=7, count=1)
        whole = deserialise(TYPE_NAME, MESSAGE)
        whole.fields = [field] * fields
        return serialise(TYPE_NAME, whole)

    assert len(decode_point_cloud(cloud(MAX_FIELDS, 1)).fields) == MAX_FIELDS
    assert len(decode_point_cloud(cloud(1, MAX_TEXT_BYTES)).fields[0].name) == MAX_TEXT_BYTES
    with pytest.raises(MessageError, match=f"with {MAX_FIELDS + 1} fields"):
        decode_point_cloud(cloud(MAX_FIELDS + 1, 1))
    with pytest.raises(MessageError, match=f"a text of {MAX_TEXT_BYTES + 1} bytes"):
        decode_point_cloud(cloud(1, MAX_TEXT_BYTES + 1))


def test_an_empty_cloud() -> None:
    cloud = decode_point_cloud(bytes(point_cloud(width=0, row_step=0, height=1, data=np.zeros(0, np.uint8)).data))
    assert (cloud.width, len(cloud.data), cloud.is_dense) == (0, 0, True)


def test_what_is_encoded_is_what_was_decoded() -> None:
    cloud = decode_point_cloud(MESSAGE)
    assert encode_point_cloud(cloud, seq=int.from_bytes(MESSAGE[:4], "little")) == MESSAGE


def test_an_encoded_cloud_is_read_by_others() -> None:
    made = replace(decode_point_cloud(MESSAGE), frame_id="größer", fields=(PointField("x", 0, 7, 1),))
    theirs = deserialise(TYPE_NAME, encode_point_cloud(made, seq=2**32 - 1))
    assert (theirs.header.seq, theirs.header.frame_id, len(theirs.fields)) == (2**32 - 1, "größer", 1)


@pytest.mark.parametrize(
    "field",
    [
        {"stamp": 2**32 * 10**9},
        {"stamp": -1},
        {"width": 2**32},
        {"frame_id": "x" * (MAX_TEXT_BYTES + 1)},
        {"frame_id": "\ud800"},
        {"fields": (PointField("x", -1, 7, 1),)},
        {"fields": (PointField("x" * (MAX_TEXT_BYTES + 1), 0, 7, 1),)},
    ],
)
def test_what_the_message_cannot_hold_is_refused(field: dict[str, Any]) -> None:
    with pytest.raises(MessageError, match=r"cannot serialise|with a text of 1025 bytes"):
        encode_point_cloud(replace(decode_point_cloud(MESSAGE), **field), seq=0)
