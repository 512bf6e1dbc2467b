import random
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.discovery import DiscoverySettings, Plan, plan
from gateway.discovery.plan import NO_PLAN
from gateway.discovery.published_topics import Topic
from gateway.to_bus.translators import kind_of
from schemas.keys import StreamKey
from schemas.status import MAX_STREAMS
from tests.gateway.discovery.graphs import (
    COMPRESSED,
    DRIVERS,
    IMAGE,
    INFO,
    POINTS,
    REALSENSE,
    TF,
    graph,
    mapping,
    named,
)

R1 = DiscoverySettings("r1")


@pytest.mark.parametrize("driver", DRIVERS)
def test_what_drivers_publish_becomes_cameras(driver: str) -> None:
    published, expected = DRIVERS[driver]
    topics = graph(published)
    made = plan(topics, R1)
    assert mapping(made) == expected
    assert made.left_out.keys() | set(expected.values()) == {topic.name for topic in topics}


def test_every_topic_left_out_has_its_reason() -> None:
    left_out = plan(graph({**REALSENSE, "std_msgs/String": "/mode", "*": "/x", "": "/y", TF: "/other/tf"}), R1).left_out
    raw, aligned = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
    assert left_out[f"{raw}/compressed"] == f"the same image as {raw}"
    assert left_out[f"{aligned}/compressedDepth"] == f"the same image as {aligned}"
    assert left_out["/camera/depth/image_rect_raw"] == f"camera/depth is {aligned}"
    assert left_out["/camera/infra1/image_rect_raw"] == f"camera/color is {raw}"
    assert "calibration" in left_out["/camera/infra1/camera_info"]
    assert "calibration or transforms" in left_out["/other/tf"]
    assert "not a sensor's message type" in left_out[f"{raw}/theora"]
    assert "text/NAME" in left_out["/mode"]
    assert "does not know" in left_out["/y"]


def test_what_gateways_alone_publish_is_not_taken() -> None:
    ours = graph({IMAGE: "/front/image_raw"}, ("/fleetsight_gateway_r2_01234567", "/fleetsight_gateway_r1_89abcdef"))
    made = plan([*ours, *graph({IMAGE: "/ultralytics/camera/image_raw"})], R1)
    assert mapping(made) == {}
    assert set(made.left_out.values()) == {"published by gateways"}


def test_what_a_gateway_and_a_sensor_publish_is_taken() -> None:
    both = graph({IMAGE: "/front/image_raw"}, ("/driver", "/fleetsight_gateway_r2_01234567"))
    assert mapping(plan(both, R1)) == {"front/color": "/front/image_raw"}


@pytest.mark.parametrize(
    ("allow", "deny", "taken"),
    [
        (".*", "", {"front/color", "rear/color"}),
        ("/front/.*", "", {"front/color"}),
        (".*", "/front/.*", {"rear/color"}),
        ("/front/.*", "/front/image_raw", set()),
        ("front", "rear", set()),
    ],
)
def test_patterns_choose_and_denial_wins(allow: str, deny: str, taken: set[str]) -> None:
    topics = graph({IMAGE: "/front/image_raw /rear/image_raw"})
    made = plan(topics, DiscoverySettings("r1", allow=re.compile(allow), deny=re.compile(deny)))
    assert set(mapping(made)) == taken
    assert len(made.left_out) == 2 - len(taken)


def test_what_the_settings_name_is_taken_as_named_though_nobody_publishes_it() -> None:
    discovery_settings = DiscoverySettings(
        "r1", named(front__color="/somewhere", ros__battery="/battery"), discover=False
    )
    made = plan(graph({IMAGE: "/rear/image_raw", "sensor_msgs/BatteryState": "/battery"}), discovery_settings)
    assert mapping(made) == {"front/color": "/somewhere", "ros/battery": "/battery"}
    assert [source.type for source in made.streams.values()] == ["", "sensor_msgs/BatteryState"]
    assert made.left_out == {}


def test_a_named_topic_is_nothing_else_and_its_camera_is_called_as_named() -> None:
    topics = graph({IMAGE: "/front/color/image_raw /front/depth/image_raw", INFO: "/front/color/camera_info"})
    made = plan(topics, DiscoverySettings("r1", named(bow__color="/front/color/image_raw")))
    assert mapping(made) == {
        "bow/color": "/front/color/image_raw",
        "bow/depth": "/front/depth/image_raw",
        "bow/info": "/front/color/camera_info",
    }


def test_another_form_of_a_named_image_is_not_taken() -> None:
    topics = graph({IMAGE: "/front/image_raw", COMPRESSED: "/front/image_raw/compressed"})
    made = plan(topics, DiscoverySettings("r1", named(ros__front="/front/image_raw/compressed")))
    assert mapping(made) == {"ros/front": "/front/image_raw/compressed"}
    assert made.left_out == {"/front/image_raw": "the same image as a topic that the settings name"}


def test_a_camera_keeps_its_name_and_what_is_better_takes_its_stream() -> None:
    first = plan(graph({IMAGE: "/a/front/infra1/image_raw"}), R1)
    assert mapping(first) == {"front/color": "/a/front/infra1/image_raw"}
    topics = graph({IMAGE: "/a/front/infra1/image_raw /a/front/color/image_raw /b/front/color/image_raw"})
    assert mapping(plan(topics, R1, first)) == {
        "b_front/color": "/b/front/color/image_raw",
        "front/color": "/a/front/color/image_raw",
    }
    assert set(mapping(plan(topics, R1))) == {"a/color", "b/color"}


def test_a_camera_that_was_gone_has_its_name_again() -> None:
    first = plan(graph({IMAGE: "/a/front/image_raw"}), R1)
    second = plan(graph({IMAGE: "/b/front/image_raw"}), R1, first)
    third = plan(graph({IMAGE: "/a/front/image_raw /b/front/image_raw"}), R1, second)
    assert mapping(third) == {"b_front/color": "/b/front/image_raw", "front/color": "/a/front/image_raw"}


def test_two_sides_stay_two_cameras_when_something_in_common_comes() -> None:
    first = plan(graph({IMAGE: "/left/image_raw /right/image_raw"}), R1)
    both = {"left/color": "/left/image_raw", "right/color": "/right/image_raw"}
    later = graph({IMAGE: "/left/image_raw /right/image_raw /image_raw"})
    assert mapping(plan(later, R1, first)) == {"camera/color": "/image_raw", **both}


def test_a_topic_of_a_type_that_its_stream_cannot_carry_is_planned_anew() -> None:
    first = plan(graph({IMAGE: "/front/color/image_raw /front/image_raw"}), R1)
    assert mapping(first) == {"front/color": "/front/color/image_raw"}
    changed = graph({POINTS: "/front/color/image_raw", IMAGE: "/front/image_raw"})
    assert mapping(plan(changed, R1, first)) == {"front/color": "/front/image_raw"}


def test_transforms_stay_when_the_master_gives_their_type_its_older_name() -> None:
    first = plan(graph({TF: "/tf"}, ("/robot_state_publisher",)), R1)
    second = plan(graph({"tf/tfMessage": "/tf"}, ("/robot_state_publisher", "/serial_node")), R1, first)
    assert mapping(first) == mapping(second) == {"tf": "/tf"}
    assert second.left_out == {}


def test_the_first_camera_stays_the_first() -> None:
    first = plan(graph({IMAGE: "/rear/image_raw", POINTS: "/points"}), R1)
    second = plan(graph({IMAGE: "/front/image_raw /rear/image_raw"}), R1, first)
    assert [str(key) for key in second.cameras] == ["r1/rear", "r1/front"]
    alone = plan(graph({IMAGE: "/front/image_raw"}), R1, second)
    assert alone.first == "rear"


def test_the_first_camera_that_the_settings_name_is_the_first() -> None:
    made = plan(
        graph({IMAGE: "/a/image_raw"}), DiscoverySettings("r1", named(rear__color="/rear", front__color="/front"))
    )
    assert [key.camera for key in made.cameras] == ["rear", "a", "front"]


def test_no_more_streams_than_a_status_lists() -> None:
    topics = graph({POINTS: " ".join(f"/lidar_{n}/points" for n in range(MAX_STREAMS)), TF: "/tf"})
    made = plan(topics, R1)
    assert len(made.streams) == MAX_STREAMS
    assert list(made.left_out.values()) == [f"over {MAX_STREAMS} streams, which is the most a gateway offers"]


def test_no_more_cameras_than_can_be_remembered() -> None:
    before = plan(graph({POINTS: " ".join(f"/lidar_{n}/points" for n in range(MAX_STREAMS))}), R1)
    made = plan(graph({IMAGE: "/front/image_raw"}), R1, before)
    assert mapping(made) == {}
    assert made.left_out == {"/front/image_raw": "over 1000 cameras, which is the most a gateway offers"}


WORDS = (
    "r1 a b camera front rear left right stereo color rgb depth depth_registered aligned_depth_to_color infra1 cam _"
    " image_raw image image_rect image_mono points points2 disparity camera_info compressed compressedDepth tf"
    " tf_static to zed zed_node status 0 ultralytics"
)
CHUNKS = st.sampled_from(WORDS.split())
NAMES = st.lists(CHUNKS, min_size=1, max_size=5).map(lambda chunks: "/" + "/".join(chunks)) | st.text(max_size=12)
TYPES = st.sampled_from([IMAGE, COMPRESSED, POINTS, INFO, TF, "stereo_msgs/DisparityImage", "std_msgs/String", ""])
NODES = st.lists(st.sampled_from(["/driver", "/fleetsight_gateway_r1_0"]), max_size=2).map(tuple)
GRAPHS = st.lists(st.builds(Topic, NAMES, TYPES, NODES), max_size=25, unique_by=lambda topic: topic.name)


def check(made: Plan, topics: list[Topic]) -> None:
    taken = [source.topic for key, source in made.streams.items() if not made.of_points(key)]
    assert len(taken) == len(set(taken))
    assert not set(taken) & made.left_out.keys()
    assert {topic.name for topic in topics} == set(taken) | made.left_out.keys()
    assert len(set(made.names.values())) == len(made.names)


@given(GRAPHS, st.randoms(use_true_random=False))
@settings(deadline=None, max_examples=150)
def test_any_topics_give_one_plan_whatever_their_order(topics: list[Topic], rng: random.Random) -> None:
    made = plan(topics, R1)
    check(made, topics)
    assert plan(rng.sample(topics, len(topics)), R1) == made
    assert plan(topics, R1, made) == made


@given(GRAPHS, GRAPHS)
@settings(deadline=None, max_examples=150)
def test_no_camera_ever_changes_its_name(before: list[Topic], after: list[Topic]) -> None:
    first = plan(before, R1, NO_PLAN)
    second = plan(after, R1, first)
    check(second, after)
    assert first.names.items() <= second.names.items()
    keys = {source.topic: key for key, source in first.streams.items() if isinstance(key, StreamKey)}
    for key, source in second.streams.items():
        known = keys.get(source.topic, key)
        assert isinstance(known, StreamKey) is isinstance(key, StreamKey)
        if isinstance(key, StreamKey) and isinstance(known, StreamKey):
            assert key.camera == known.camera


@pytest.mark.parametrize(
    ("points", "color"),
    [
        ("/front/depth_registered/points", True),
        ("/front/depth/color/points", True),
        ("/front/rgb/points", True),
        ("/front/depth/points", False),
        ("/cloud_registered", False),
        ("/velodyne_points", False),
    ],
)
def test_the_picture_in_a_coloured_cloud_is_the_colour_of_a_camera_that_has_no_other(
    points: str, *, color: bool
) -> None:
    made = plan(graph({POINTS: points}), R1)
    streams = {key.stream: source.topic for key, source in made.streams.items()}
    assert streams == {"points": points, **({"color": points} if color else {})}
    assert [made.of_points(key) for key in made.streams] == [False, True][: len(streams)]
    assert made.left_out == {}


def test_a_camera_with_a_colour_image_needs_none_from_its_points() -> None:
    points = "/front/depth_registered/points"
    lone = plan(graph({POINTS: points}), R1)
    made = plan(graph({POINTS: points, IMAGE: "/front/rgb/image_raw"}), R1, lone)
    assert mapping(made) == {"front/color": "/front/rgb/image_raw", "front/points": points}
    assert not any(made.of_points(key) for key in made.streams)


def test_the_settings_can_name_a_cloud_for_both() -> None:
    made = plan(
        [], DiscoverySettings("r1", named(front__color="/p", front__points="/p", rear__color="/p"), discover=False)
    )
    assert [key.name for key in made.streams if made.of_points(key)] == ["front/color"]


@pytest.mark.parametrize(
    ("color", "depth", "rectified"),
    [
        ("/front/image_raw", "/front/depth/image_raw", set()),
        ("/front/image_rect_color", "/front/depth/image_raw", {"front/info"}),
        ("/front/image_color_rect/compressed", "/front/depth/image_raw", {"front/info"}),
        ("/front/image_color", "/front/image_depth_rect", {"front/depth_info"}),
        ("/front/image_raw", "/stereo/disparity", {"front/depth_info"}),
        ("/correct/image_raw", "/direct/depth/image_raw", set()),
    ],
)
def test_the_calibration_of_a_rectified_picture_is_another_one(color: str, depth: str, rectified: set[str]) -> None:
    infos = {"front__info": "/front/camera_info", "front__depth_info": "/front/depth/camera_info", "tf": "/tf"}
    made = plan([], DiscoverySettings("r1", named(front__color=color, front__depth=depth, **infos), discover=False))
    assert {key.name for key in made.streams if made.kind_of(key) is not kind_of(key)} == rectified


DISPARITY, OWN_INFO = "stereo_msgs/DisparityImage", "/front/depth/camera_info"
COLORS = "/front/image_color /front/image_rect_color"
INFO_OF_COLORS = {INFO: "/front/camera_info"}


@pytest.mark.parametrize(
    ("topics", "color"),
    [
        ({IMAGE: COLORS, DISPARITY: "/front/disparity", **INFO_OF_COLORS}, "/front/image_rect_color"),
        ({IMAGE: COLORS, DISPARITY: "/front/disparity"}, "/front/image_rect_color"),
        ({IMAGE: f"{COLORS} /front/depth/image_rect", **INFO_OF_COLORS}, "/front/image_rect_color"),
        ({IMAGE: f"{COLORS} /front/depth/image_rect", INFO: OWN_INFO}, "/front/image_color"),
        ({IMAGE: f"{COLORS} /front/depth/image_raw", **INFO_OF_COLORS}, "/front/image_color"),
        ({IMAGE: COLORS, **INFO_OF_COLORS}, "/front/image_color"),
        ({IMAGE: "/front/image_raw /front/image_rect", DISPARITY: "/front/disparity"}, "/front/image_rect"),
        ({IMAGE: "/front/image_raw /front/infra1/image_rect_raw", DISPARITY: "/front/disparity"}, "/front/image_raw"),
        ({IMAGE: "/s/left/image_raw /s/right/image_rect", DISPARITY: "/s/disparity"}, "/s/left/image_raw"),
    ],
)
def test_beside_rectified_depth_without_a_calibration_of_its_own_colour_is_rectified_too(
    topics: dict[str, str], color: str
) -> None:
    made = plan(graph(topics), R1)
    (key,) = (key for key in made.streams if isinstance(key, StreamKey) and key.stream == "color")
    assert made.streams[key].topic == color


def test_depth_and_calibrations_that_the_settings_name_count_for_colour_that_is_found() -> None:
    topics = graph({IMAGE: COLORS, **INFO_OF_COLORS})
    depth, depth_info = named(front__depth="/front/depth/image_raw"), named(front__depth_info="/range_info")
    rectified = frozenset(depth)
    taken = [
        mapping(plan(topics, DiscoverySettings("r1", wished, rectified=marked)))["front/color"]
        for wished, marked in ((depth, frozenset()), (depth, rectified), ({**depth, **depth_info}, rectified))
    ]
    assert taken == ["/front/image_color", "/front/image_rect_color", "/front/image_color"]


def test_a_stereo_cameras_calibration_is_that_of_its_rectified_pictures() -> None:
    published, _ = DRIVERS["stereo in colour"]
    made = plan(graph(published), R1)
    assert [key.name for key in made.streams if made.kind_of(key) is not kind_of(key)] == ["stereo/info"]


def test_wishes_say_that_a_picture_is_rectified_which_is_not_named_so() -> None:
    streams = named(front__color="/a", front__info="/a/camera_info", rear__color="/b", rear__info="/b/camera_info")
    rectified = frozenset(named(front__color="", rear__depth=""))
    made = plan([], DiscoverySettings("r1", streams, discover=False, rectified=rectified))
    assert {key.name for key in made.streams if made.kind_of(key) is not kind_of(key)} == {"front/info"}
