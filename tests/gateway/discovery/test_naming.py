import pytest

from gateway.discovery.candidates import name_cameras
from gateway.discovery.topic_names import Path


def names(*paths: str, robot: str = "r1", given: dict[Path, str] | None = None, taken: str = "") -> dict[str, str]:
    found = [tuple(path.split("/")) if path else () for path in paths]
    named = name_cameras(found, robot, given or {}, taken.split())
    return {"/".join(path): name for path, name in named.items()}


@pytest.mark.parametrize(
    ("paths", "expected"),
    [
        (["front"], ["front"]),
        ([""], ["camera"]),
        (["r1/front"], ["front"]),
        (["r1"], ["r1"]),
        (["a/b/front", "a/b/rear"], ["front", "rear"]),
        (["a/front", "b/front"], ["a", "b"]),
        (["front", "r2/front"], ["front", "r2_front"]),
        (["front", "r1/front"], ["front", "r1_front"]),
        (["a/front", "b/front", "rear"], ["a_front", "b_front", "rear"]),
        (["zed/zed_node"], ["zed"]),
        (["a/zed/zed_node", "b/zed/zed_node"], ["a", "b"]),
        (["_", "_x"], ["camera", "x"]),
        (["status", "ros"], ["status_camera", "ros_camera"]),
        (["x" * 70], ["x" * 64]),
        (["x" * 64, "x" * 65], ["x" * 64, "x" * 58 + "_2"]),
    ],
)
def test_a_name_is_what_tells_a_camera_from_the_others(paths: list[str], expected: list[str]) -> None:
    assert [names(*paths)[path] for path in paths] == expected


def test_names_do_not_depend_on_the_order() -> None:
    paths = ["a/front", "b/front", "front", "r1/front", ""]
    assert names(*paths) == names(*reversed(paths))


def test_a_robots_name_that_is_no_ros_name_is_known_as_ros_would_have_it() -> None:
    assert names("r_1_a/front/x", "r_1_a/x", robot="r-1.a")["r_1_a/x"] == "x"


def test_who_has_a_name_keeps_it() -> None:
    given: dict[Path, str] = {("a", "front"): "front", ("gone",): "b"}
    assert names("b/front", given=given)["b/front"] == "b_front"
    assert names("x/b", given=given)["x/b"] == "x_b"


def test_names_that_ros_cannot_tell_apart_are_not_given_twice() -> None:
    assert names("a/rear_2", taken="rear-2")["a/rear_2"] == "a_rear_2"
    assert names("rear_2", taken="rear.2")["rear_2"] == "rear_2_2"
