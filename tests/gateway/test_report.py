from gateway.discovery import DiscoverySettings, plan
from gateway.discovery.published_topics import Topic
from gateway.exploring import changes
from tests.gateway.discovery.graphs import IMAGE, POINTS, TF, graph, heard

R1 = DiscoverySettings("r1")
BEFORE = plan(graph({IMAGE: "/front/image_raw /rear/image_raw", TF: "/tf", "std_msgs/String": "/mode"}), R1)


def test_what_became_what_and_what_was_left_out() -> None:
    assert changes(BEFORE) == [
        "tf: /tf (tf2_msgs/TFMessage)",
        "front/color: /front/image_raw (sensor_msgs/Image)",
        "rear/color: /rear/image_raw (sensor_msgs/Image)",
        "left out, a text; --discover --topics text/NAME=TOPIC takes it as well: /mode",
    ]


def test_only_changes_are_said() -> None:
    assert changes(BEFORE, BEFORE) == []
    published = {IMAGE: "/front/color/image_raw /front/image_raw", POINTS: "/front/points", "std_msgs/String": "/mode"}
    now = plan(graph(published), R1, BEFORE)
    assert changes(now, BEFORE) == [
        "front/color: /front/color/image_raw (sensor_msgs/Image) now, no longer /front/image_raw",
        "front/points: /front/points (sensor_msgs/PointCloud2)",
        "rear/color: no longer offered, /rear/image_raw is gone",
        "tf: no longer offered, /tf is gone",
        "left out, front/color is /front/color/image_raw: /front/image_raw",
    ]


def test_a_topic_that_turns_into_something_else_is_not_gone() -> None:
    published = {IMAGE: "/rear/image_raw", TF: "/tf", "std_msgs/String": "/mode /front/image_raw"}
    assert changes(plan(graph(published), R1, BEFORE), BEFORE) == [
        "front/color: no longer offered, /front/image_raw is left out",
        "left out, a text; --discover --topics text/NAME=TOPIC takes it as well: /front/image_raw",
    ]


def test_a_topic_that_is_taken_for_another_stream_is_not_gone() -> None:
    topics = graph({IMAGE: "/oak/stereo/image_raw"})
    before = plan(topics, R1)
    assert changes(plan(heard(topics, stereo="16UC1"), R1, before), before) == [
        "stereo/depth: /oak/stereo/image_raw (sensor_msgs/Image)",
        "stereo/color: no longer offered, /oak/stereo/image_raw is stereo/depth",
    ]


def test_a_named_topic_is_said_before_it_is_known_and_once_it_is() -> None:
    discovery_settings = DiscoverySettings(
        "r1", dict.fromkeys(plan(graph({IMAGE: "/front/image_raw"}), R1).streams, "/x"), discover=False
    )
    before = plan([], discovery_settings)
    assert changes(before) == ["front/color: /x (not known to the ROS master yet)"]
    now = plan(graph({IMAGE: "/x"}), discovery_settings, before)
    assert changes(now, before) == ["front/color: /x (sensor_msgs/Image) now"]


def test_many_topics_left_out_for_one_reason_are_one_short_line() -> None:
    made = plan(graph({"std_msgs/String": " ".join(f"/text_{n:02}" for n in range(15))}), R1)
    (line,) = changes(made)
    assert line.endswith("/text_10, /text_11 and 3 more")


def test_what_no_topic_can_be_called_writes_no_line_of_its_own() -> None:
    (line,) = changes(plan([Topic("/a\n2026 ERROR" + "x" * 999, "std_msgs/String", ("/n",))], R1))
    assert "'/a\\n2026 ERRORxxx" in line
    assert len(line) < 200
