from typing import Any

import numpy as np
import pytest

from gateway.ros1.messages import new_message
from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import MALFORMED, StreamForward
from gateway.to_bus.translators import kind_of
from gateway.to_bus.translators.points import shows_picture
from schemas import codec, keys
from schemas.image import ImageFrame
from tests.gateway.sensing import STAMP_NS, point_cloud

COLOR = keys.sensor_key("r1", "front/color")
RGB = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)


def colored(*, is_bigendian: bool = False, padding: int = 0, **changes: Any) -> Message:
    """Return two rows of three points of x and rgb."""
    fields = [
        new_message("sensor_msgs/PointField", name="x", offset=0, datatype=7, count=1),
        new_message("sensor_msgs/PointField", name="rgb", offset=4, datatype=7, count=1),
    ]
    points = np.zeros((2, 3, 8), np.uint8)
    points[..., [5, 6, 7] if is_bigendian else [6, 5, 4]] = RGB
    data = np.pad(points.reshape(2, 24), ((0, 0), (0, padding)), constant_values=9).ravel()
    layout = {"fields": fields, "row_step": 24 + padding, "data": data, "is_bigendian": is_bigendian}
    return point_cloud(**{**layout, **changes})


def stream() -> StreamForward:
    return StreamForward(COLOR, "/front/points", kind_of(COLOR, of_points=True), "boot")


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 5])
def test_an_organised_clouds_colours_are_a_picture_of_its_instant(padding: int, *, is_bigendian: bool) -> None:
    made = stream().take(colored(is_bigendian=is_bigendian, padding=padding), 99)
    assert made is not None
    frame = codec.decode(ImageFrame, codec.encode(made), codec.encoding(ImageFrame))
    assert (frame.height, frame.width, frame.encoding, frame.step) == (2, 3, "rgb8", 9)
    assert bytes(frame.data) == RGB.tobytes()
    assert (frame.header.stamp_ns, frame.header.frame_id) == (STAMP_NS, "lidar")
    assert (frame.header.camera, frame.header.seq, frame.header.received_ns) == ("front", 0, 99)


@pytest.mark.parametrize(
    "cloud",
    [point_cloud(), colored(height=1, width=6, row_step=48), colored(height=6, width=1, row_step=8), colored(height=3)],
    ids=["without colours", "a row", "a column", "of another size than its header says"],
)
def test_what_is_no_picture_is_malformed(cloud: Message) -> None:
    forward = stream()
    assert forward.take(cloud, 99) is None
    assert forward.status(wanted=True, publishers=1, replaced=0, broken_links={}).dropped == {MALFORMED: 1}


UNORDERED = colored(height=1, width=6, row_step=48)
EMPTY = colored(height=1, width=0, row_step=0, data=np.zeros(0, np.uint8))


@pytest.mark.parametrize(
    ("cloud", "shows"),
    [
        (colored(), True),
        (colored(row_step=0), True),
        (UNORDERED, False),
        (colored(height=6, width=1, row_step=8), False),
        (point_cloud(), False),
        (EMPTY, None),
        (colored(height=3), None),
        (EMPTY._replace(data=b"garbage"), None),
    ],
)
def test_a_cloud_tells_whether_it_is_a_picture(cloud: Message, *, shows: bool | None) -> None:
    assert shows_picture(cloud) is shows


@pytest.mark.parametrize("cloud", [UNORDERED, point_cloud(), colored(height=6, width=1, row_step=8)])
def test_a_driver_that_sends_no_pictures_is_known_by_its_first_cloud(cloud: Message) -> None:
    forward = stream()
    forward.take(EMPTY, 99)  # nothing was seen yet
    forward.take(colored(height=3), 99)
    assert forward.no_picture == ""
    forward.take(cloud, 99)
    assert "is not an image: have its driver send" in forward.no_picture
    forward.take(colored(), 99)
    assert forward.no_picture == ""


def test_a_driver_that_has_sent_a_picture_is_one_that_does() -> None:
    forward = stream()
    for cloud in (colored(), UNORDERED):
        forward.take(cloud, 99)
    assert forward.no_picture == ""


def test_a_picture_whose_row_step_is_wrong_is_repaired() -> None:
    forward = stream()
    frame = forward.take(colored(row_step=0), 99)
    assert isinstance(frame, ImageFrame)
    assert bytes(frame.data) == RGB.tobytes()
    assert forward.status(wanted=True, publishers=1, replaced=0, broken_links={}).repaired == 1
