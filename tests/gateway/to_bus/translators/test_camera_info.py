import numpy as np
import pytest

from gateway.ros1.tcpros.subscriber import Message
from gateway.to_bus.stream import MALFORMED, StreamForward
from gateway.to_bus.translators import kind_of
from schemas import keys
from schemas.camera_info import MAX_DISTORTION, CameraInfo, Region
from schemas.header import MAX_LABEL
from tests.gateway.sensing import STAMP_NS, camera_info
from tests.gateway.to_bus.translators.translating import dropped, translated

INFO = keys.sensor_key("r1", "front/info")


@pytest.mark.parametrize("stream", ["info", "depth_info"])
def test_a_calibration_arrives_whole(stream: str) -> None:
    made = translated(CameraInfo, f"front/{stream}", camera_info())
    assert (made.header.stamp_ns, made.header.frame_id, made.header.camera) == (STAMP_NS, "lens", "front")
    assert (made.height, made.width, made.distortion_model) == (480, 640, "plumb_bob")
    assert made.d == [0.1, -0.2, 0.0, 0.0, 0.5]
    assert (made.k, made.p) == ([float(number) for number in range(9)], [float(number) for number in range(12)])
    assert made.r == [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    assert (made.binning_x, made.binning_y) == (1, 2)
    assert made.roi == Region(x_offset=1, y_offset=2, height=3, width=4, do_rectify=True)


def test_an_uncalibrated_camera_says_so() -> None:
    made = translated(CameraInfo, "front/info", camera_info(height=0, width=0, D=np.zeros(0), K=np.zeros(9)))
    assert (made.height, made.width, made.d, made.k[0]) == (0, 0, [], 0.0)


def of_rectified(info: Message) -> CameraInfo:
    stream = StreamForward(INFO, "/topic", kind_of(INFO, of_rectified=True), "boot")
    made = stream.take(info, 99)
    assert isinstance(made, CameraInfo)
    return made


def test_a_rectified_picture_is_that_of_the_straight_camera_that_p_describes() -> None:
    p = [500.0, 0.0, 320.0, -30.0, 0.0, 510.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    made = of_rectified(camera_info(R=np.arange(9.0), P=np.array(p)))
    assert (made.distortion_model, made.d) == ("plumb_bob", [])
    assert made.k == [500, 0, 320, 0, 510, 240, 0, 0, 1]
    assert made.p == p
    assert made.r == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert (made.height, made.width, made.header.frame_id) == (480, 640, "lens")


def test_where_p_says_nothing_k_and_d_are_all_that_is_known() -> None:
    made = of_rectified(camera_info(P=np.eye(3, 4).ravel() * (0, *[1] * 11)))
    assert (made.d, made.k) == ([0.1, -0.2, 0.0, 0.0, 0.5], [float(number) for number in range(9)])


def test_the_most_distortion_and_the_longest_name_and_one_more() -> None:
    most = camera_info(D=np.zeros(MAX_DISTORTION), distortion_model="x" * MAX_LABEL)
    assert len(translated(CameraInfo, "front/info", most).d) == MAX_DISTORTION
    assert dropped("front/info", camera_info(D=np.zeros(MAX_DISTORTION + 1))) == {MALFORMED: 1}
    assert dropped("front/info", camera_info(distortion_model="x" * (MAX_LABEL + 1))) == {MALFORMED: 1}
