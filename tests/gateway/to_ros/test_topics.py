import pytest

from gateway.ros1.names import resolve
from gateway.to_ros.outputs import is_result, result_root


def test_the_first_cameras_results_are_where_the_guides_users_look() -> None:
    assert result_root("front", first=True) == "ultralytics"
    assert result_root("rear", first=False) == "ultralytics/rear"


@pytest.mark.parametrize("camera", ["a-b.c", "0", "A_1"])
def test_any_cameras_name_makes_a_legal_ros_name(camera: str) -> None:
    assert is_result(resolve(result_root(camera, first=False), "/r1/gateway"))


@pytest.mark.parametrize(
    ("topic", "result"),
    [
        ("/ultralytics", True),
        ("/ultralytics/detection/classes", True),
        ("/ultralytics2/image", False),
        ("/r1/ultralytics/detection/classes", True),
        ("/ultralytics_camera/image", False),
    ],
)
def test_results_are_told_from_sensors(topic: str, *, result: bool) -> None:
    assert is_result(topic) is result
