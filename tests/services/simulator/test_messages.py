from typing import Any

import numpy as np
import pytest

from gateway.ros1.image import decode_image
from gateway.ros1.messages import deserialise
from gateway.ros1.point_cloud import decode_point_cloud
from services.simulator.messages import Head, cloud_message, image_message, info_message, transforms_message
from services.simulator.placement import at
from services.simulator.world import Camera

STAMP = 1_700_000_000_000_000_005
HEAD = Head(7, STAMP, "lens")


@pytest.mark.parametrize(
    ("pixels", "encoding", "step"),
    [
        (np.arange(18, dtype=np.uint8).reshape(2, 3, 3), "rgb8", 9),
        (np.array([[1000, 0, 65535], [1, 2, 3]], np.uint16), "16UC1", 6),
        (np.array([[1.5, np.nan, 0.25], [1, 2, 3]], np.float32), "32FC1", 12),
    ],
)
def test_images_have_the_encoding_of_their_numbers(pixels: np.ndarray, encoding: str, step: int) -> None:
    found = decode_image(image_message(HEAD, pixels))
    assert (found.seq, found.stamp, found.frame_id) == (7, STAMP, "lens")
    assert (found.height, found.width, found.encoding, found.step) == (2, 3, encoding, step)
    assert bytes(found.data) == pixels.tobytes()
    assert not found.is_bigendian


def test_an_info_is_that_of_a_camera_without_distortion() -> None:
    camera = Camera(width=64, height=48, fx=50.0, fy=51.0, cx=31.5, cy=23.5)
    info: Any = deserialise("sensor_msgs/CameraInfo", info_message(HEAD, camera))
    assert (info.width, info.height, info.distortion_model) == (64, 48, "plumb_bob")
    assert (info.header.frame_id, info.header.stamp.sec, info.header.stamp.nanosec) == ("lens", 1_700_000_000, 5)
    assert info.K.tolist() == [50, 0, 31.5, 0, 51, 23.5, 0, 0, 1]
    assert info.P.tolist() == [50, 0, 31.5, 0, 0, 51, 23.5, 0, 0, 0, 1, 0]
    assert info.R.tolist() == np.eye(3).ravel().tolist()
    assert info.D.tolist() == [0] * 5


def test_a_cloud_has_the_fields_of_its_points() -> None:
    points = np.zeros((2, 3), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2")])
    points["x"][1, 2] = 1.5
    found = decode_point_cloud(cloud_message(HEAD, points))
    assert [(field.name, field.offset, field.datatype, field.count) for field in found.fields] == [
        ("x", 0, 7, 1),
        ("y", 4, 7, 1),
        ("z", 8, 7, 1),
        ("ring", 12, 4, 1),
    ]
    assert (found.height, found.width, found.point_step, found.row_step, found.is_dense) == (2, 3, 14, 42, True)
    assert (found.stamp, found.frame_id) == (STAMP, "lens")
    assert bytes(found.data) == points.tobytes()


def test_a_cloud_with_holes_says_so() -> None:
    points = np.full((1, 2), np.nan, [("x", "<f4")])
    assert not decode_point_cloud(cloud_message(HEAD, points)).is_dense


def test_transforms_say_where_children_are_in_their_parents() -> None:
    found: Any = deserialise(
        "tf2_msgs/TFMessage", transforms_message(STAMP, [("map", "odom", at(1, 2, 3, yaw=np.pi / 2))])
    )
    (only,) = found.transforms
    assert (only.header.frame_id, only.child_frame_id, only.header.stamp.nanosec) == ("map", "odom", 5)
    assert (only.transform.translation.x, only.transform.translation.y, only.transform.translation.z) == (1, 2, 3)
    rotation = only.transform.rotation
    assert (rotation.x, rotation.y, rotation.z, rotation.w) == pytest.approx((0, 0, 0.5**0.5, 0.5**0.5), abs=1e-9)
