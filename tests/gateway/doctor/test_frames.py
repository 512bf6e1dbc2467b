import pytest

from gateway.doctor.evidence import StreamLook
from gateway.doctor.finding import Severity, Stage
from gateway.doctor.frames import check_frames, connected
from schemas.transforms import Transforms
from tests.gateway.doctor.seeing import TF, color, color_info, depth, evidence, links, sends

LINKS = [("base", "color"), ("base", "/mount"), ("mount", "depth"), ("map", "odom")]


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ("color", "depth", True),
        ("depth", "color", True),
        ("/color", "depth", True),
        ("base", "base", True),
        ("unheard", "unheard", True),
        ("color", "odom", False),
        ("color", "unheard", False),
    ],
)
def test_frames_hang_together_through_any_number_of_transforms(one: str, other: str, *, expected: bool) -> None:
    assert connected(LINKS, one, other) is expected


def test_a_loop_ends() -> None:
    assert not connected([("a", "b"), ("b", "c"), ("c", "a")], "a", "z")


def said(*streams: StreamLook, tf: Transforms | None = None, tf_static: Transforms | None = None) -> list[str]:
    """Return what is said of frames, each with its subject."""
    heard = {"tf": tf, "tf_static": tf_static}
    beside = tuple(sends(name, f"/{name}", TF, message) for name, message in heard.items() if message)
    found = list(check_frames(evidence(*streams, beside=beside)))
    assert {(each.stage, each.severity) for each in found} <= {(Stage.CAMERAS, Severity.NOTE)}
    return [f"{each.subject}: {each.what} -> {each.advice}" for each in found]


def test_cameras_whose_frames_hang_below_the_robot() -> None:
    tree = links(("map", "odom"), ("odom", "base_link"), ("base_link", "mount"))
    assert said(color(), depth(), tf=tree, tf_static=links(("/mount", "/lens"))) == []


def test_without_the_robots_own_frame_any_transform_will_do() -> None:
    assert said(color(), depth(), tf_static=links(("lens", "other"))) == []


def test_a_camera_in_a_frame_that_no_transform_has() -> None:
    (finding,) = said(color(), depth(frame_id="depth_lens"), tf_static=links(("base_link", "lens"), ("a", "b")))
    assert finding == (
        "front: its frame 'depth_lens' is in no transform that came in 3 s -> publish where it is, in metres and "
        "radians: `rosrun tf2_ros static_transform_publisher X Y Z YAW PITCH ROLL base_link depth_lens`"
    )


def test_a_frame_whose_name_is_nearly_that_of_another() -> None:
    (finding,) = said(
        color(frame_id="front_lens_frame"), depth(frame_id="front_lens_frame"), tf=links(("base", "front_lens"))
    )
    assert "is it 'front_lens' there? Then set the driver's frame_id to that" in finding


def test_a_camera_that_hangs_below_nothing_of_the_robot() -> None:
    tree = links(("odom", "base_footprint"), ("camera_link", "mount"), ("mount", "lens"))
    (finding,) = said(color(), depth(), tf=tree)
    assert "no transform that came in 3 s leads from its frame 'lens' to 'base_footprint'" in finding
    assert finding.endswith("ROLL base_footprint camera_link`")


def test_a_loop_above_a_camera_ends() -> None:
    (finding,) = said(depth(), tf=links(("odom", "base_link"), ("a", "lens"), ("lens", "a")))
    assert "leads from its frame 'lens' to 'base_link'" in finding


def test_images_without_a_frame() -> None:
    (finding,) = said(depth(frame_id=""), tf=links(("odom", "base_link")))
    assert finding.startswith("front: its images or points are in no frame: header.frame_id is empty")


def test_a_robot_without_transforms() -> None:
    (finding,) = said(color(), depth(), color_info())
    assert finding.startswith("r1: no transforms came on /tf or /tf_static: ")


def test_pictures_alone_need_no_transforms() -> None:
    assert said(color()) == said(color(), color_info()) == []
