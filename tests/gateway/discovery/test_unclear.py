"""Topics whose names do not tell what they are, but their messages do."""

import re

import pytest

from gateway.discovery import DiscoverySettings, plan, unclear, unclear_clouds
from gateway.exploring import changes
from gateway.to_bus.translators.pixel_encoding import UNKNOWN
from tests.gateway.discovery.graphs import COMPRESSED, IMAGE, INFO, POINTS, graph, heard, mapping, named

R1 = DiscoverySettings("r1")
OAK = {
    IMAGE: "/oak/rgb/image_raw /oak/stereo/image_raw /oak/left/image_raw",
    INFO: "/oak/rgb/camera_info /oak/stereo/camera_info",
}
OAK_STREAMS = {
    "color": "/oak/rgb/image_raw",
    "depth": "/oak/stereo/image_raw",
    "info": "/oak/rgb/camera_info",
    "depth_info": "/oak/stereo/camera_info",
}


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
@pytest.mark.parametrize(
    "named_by_hand",
    [
        {},
        {"depth": "/oak/stereo/image_raw"},
        {"color": "/oak/rgb/image_raw"},
        {"color": "/oak/rgb/image_raw", "depth": "/oak/stereo/image_raw"},
    ],
    ids=lambda named: "+".join(named) or "found",
)
def test_depth_that_is_not_named_so_is_depth_of_the_camera_beside_it(
    encoding: str, named_by_hand: dict[str, str]
) -> None:
    camera = "bow" if named_by_hand else "oak"
    discovery_settings = DiscoverySettings(
        "r1", named(**{f"bow__{stream}": topic for stream, topic in named_by_hand.items()})
    )
    made = plan(heard(graph(OAK), stereo=encoding, left="mono8"), discovery_settings)
    assert mapping(made) == {f"{camera}/{stream}": topic for stream, topic in OAK_STREAMS.items()}
    assert made.left_out == {"/oak/left/image_raw": f"{camera}/color is /oak/rgb/image_raw"}


@pytest.mark.parametrize(
    ("encoding", "streams"),
    [
        ("16UC1", {"stereo/depth": "/oak/stereo/image_raw", "stereo/depth_info": "/oak/stereo/camera_info"}),
        ("mono8", {"stereo/color": "/oak/stereo/image_raw", "stereo/info": "/oak/stereo/camera_info"}),
        ("", {"stereo/color": "/oak/stereo/image_raw", "stereo/info": "/oak/stereo/camera_info"}),
    ],
)
def test_an_image_alone_is_what_its_pixels_say(encoding: str, streams: dict[str, str]) -> None:
    topics = heard(graph({IMAGE: "/oak/stereo/image_raw", INFO: "/oak/stereo/camera_info"}), stereo=encoding)
    assert mapping(plan(topics, R1)) == streams


def test_a_named_topic_and_what_is_beside_it_are_one_camera_whatever_it_is_called() -> None:
    topics = graph({IMAGE: "/cam0/picture /cam0/depth/image_raw /picture /image_raw", INFO: "/cam0/camera_info"})
    made = plan(topics, DiscoverySettings("r1", named(bow__color="/cam0/picture", stern__color="/picture")))
    assert mapping(made) == {
        "bow/color": "/cam0/picture",
        "bow/depth": "/cam0/depth/image_raw",
        "bow/info": "/cam0/camera_info",
        "stern/color": "/picture",
        "camera/color": "/image_raw",
    }


def test_two_sides_that_the_settings_name_stay_two_cameras() -> None:
    sides = named(a__color="/s/left/image_raw", b__color="/s/right/image_raw")
    made = plan(
        graph({IMAGE: "/s/left/image_raw /s/right/image_raw /s/depth/image_raw"}), DiscoverySettings("r1", sides)
    )
    assert mapping(made) == {
        "a/color": "/s/left/image_raw",
        "b/color": "/s/right/image_raw",
        "s/depth": "/s/depth/image_raw",
    }


def test_infrared_of_an_encoding_of_depth_is_neither() -> None:
    made = plan(heard(graph({IMAGE: "/camera/ir/image_raw /camera/rgb/image_raw"}), ir="16UC1"), R1)
    assert mapping(made) == {"camera/color": "/camera/rgb/image_raw"}
    assert "name says infrared" in made.left_out["/camera/ir/image_raw"]


def test_words_amid_names_pair_depth_with_its_colour() -> None:
    topics = graph({IMAGE: "/front_depth_camera/image_raw /front_rgb_camera/image_raw /rear/depth/wide/image_raw"})
    assert mapping(plan(topics, R1)) == {
        "front_camera/color": "/front_rgb_camera/image_raw",
        "front_camera/depth": "/front_depth_camera/image_raw",
        "wide/depth": "/rear/depth/wide/image_raw",
    }


@pytest.mark.parametrize("points", ["/depth_camera", "/depth/lidar", "/depth_camera/points"])
def test_words_amid_the_names_of_points_leave_them_points(points: str) -> None:
    assert points in mapping(plan(graph({POINTS: points}), R1)).values()


def test_only_images_whose_names_do_not_tell_are_looked_at() -> None:
    told = "/a/rgb/image_raw /a/depth/image_raw /a/image_mono /a/tracker/debug/image"
    asked = "/a/image_raw /a/stereo/image_raw /a/infra1/image_raw"
    topics = graph({IMAGE: f"{told} {asked}", COMPRESSED: "/a/image_raw/compressed /b/image/compressed", POINTS: "/p"})
    assert {topic.name for topic in unclear(topics, R1)} == {*asked.split(), "/b/image/compressed"}
    assert unclear(heard(topics, image="rgb8"), R1) == []
    assert unclear(topics, DiscoverySettings("r1", discover=False)) == []
    by_hand = DiscoverySettings("r1", named(front__color="/a/image_raw"), allow=re.compile("/a/.*"))
    assert {topic.name for topic in unclear(topics, by_hand)} == {"/a/stereo/image_raw", "/a/infra1/image_raw"}


@pytest.mark.parametrize("told", [UNKNOWN, "bgr8"])
def test_clouds_that_turned_out_to_be_no_pictures_give_no_colour(told: str) -> None:
    points = "/front/depth/color/points"
    named_so = graph({POINTS: points})
    none = heard(named_so, points=told)
    before = plan(named_so, R1)
    made = plan(none, R1, before)
    assert (mapping(made), made.cameras, made.left_out) == ({"front/points": points}, [], {})
    assert changes(made, before) == [f"front/color: no longer offered, {points} has points and no picture"]
    assert mapping(plan(named_so, R1, made)) == mapping(before)
    assert mapping(plan(heard(named_so, points="rgb8"), R1, made)) == mapping(before)
    named_both = DiscoverySettings("r1", named(front__color=points, front__points=points))
    assert mapping(plan(none, named_both)) == mapping(before)


def test_clouds_are_looked_at_where_they_would_be_the_only_colour_of_a_camera() -> None:
    points = "/front/depth/color/points"
    topics = graph({POINTS: f"{points} /rear/rgb/points /lidar/points", IMAGE: "/rear/image_raw"})
    without = plan(heard(topics, points=UNKNOWN), R1)
    assert [topic.name for topic in unclear_clouds(topics, R1, without)] == [points]
    assert unclear_clouds(heard(topics, points=UNKNOWN), R1, without) == []
    assert unclear_clouds(topics, R1, plan(topics, R1)) == []
    by_hand = DiscoverySettings("r1", named(front__points=points), discover=False)
    assert unclear_clouds(topics, by_hand, plan(topics, by_hand)) == []
