import numpy as np
import pytest

from gateway.stream import MALFORMED
from schemas.camera_info import MAX_DISTORTION, CameraInfo, Region
from schemas.header import MAX_LABEL
from tests.gateway.sensing import STAMP_NS, camera_info
from tests.gateway.translators.translating import dropped, translated


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


def test_the_most_distortion_and_the_longest_name_and_one_more() -> None:
    most = camera_info(D=np.zeros(MAX_DISTORTION), distortion_model="x" * MAX_LABEL)
    assert len(translated(CameraInfo, "front/info", most).d) == MAX_DISTORTION
    assert dropped("front/info", camera_info(D=np.zeros(MAX_DISTORTION + 1))) == {MALFORMED: 1}
    assert dropped("front/info", camera_info(distortion_model="x" * (MAX_LABEL + 1))) == {MALFORMED: 1}
