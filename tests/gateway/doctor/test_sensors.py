from dataclasses import replace

import pytest

from gateway.doctor.evidence import Failure, Graph, Heard, MasterLook, PublisherLook, StreamLook, Trouble
from gateway.doctor.finding import Finding, Severity, Stage
from gateway.doctor.sensors import check_sensors
from gateway.ros1.wire.tcpros import TopicType
from tests.gateway.doctor.seeing import IMAGE, TF, color, evidence, heard, publisher, sends, stream

TOPIC = "/front/color/image_raw"


def found(look: StreamLook, *others: StreamLook) -> Finding:
    """Return the only thing that is said of a stream."""
    (finding,) = (each for each in check_sensors(evidence(look, *others)) if each.subject == look.subject)
    assert finding.stage is Stage.SENSORS
    return finding


def test_a_topic_that_flows_says_how_fast() -> None:
    finding = found(color())
    assert (finding.severity, finding.what) == (Severity.OK, "/camera sends 10.0 messages/s, 100 bytes each")


def test_sizes_of_images_are_told_in_megabytes() -> None:
    big = replace(heard(), size=921_664)
    assert "0.92 MB" in found(stream("front/color", TOPIC, IMAGE, publisher(IMAGE, big))).what


def test_without_a_master_nothing_is_said_of_topics() -> None:
    nothing = evidence(color(), master=MasterLook("http://robot:11311", Trouble(Failure.DEAD, "robot", 11311)))
    assert not list(check_sensors(nothing))


def test_a_robot_without_any_stream() -> None:
    (finding,) = check_sensors(evidence())
    assert (finding.severity, finding.what) == (Severity.PROBLEM, "no topic becomes a stream")


def test_a_missing_topic_is_told_with_the_nearest_that_the_stream_can_carry() -> None:
    missing = stream("front/color", "/frnt/color/image_raw", "")
    finding = found(missing, color(), sends("tf", "/frnt/color/image_raws", TF))
    assert (finding.severity, finding.what) == (Severity.PROBLEM, "no such topic exists")
    assert finding.advice.startswith("did you mean /front/color/image_raw? ")


def test_a_missing_topic_without_a_near_one() -> None:
    assert found(stream("front/color", "/x", "")).advice.startswith("Start the sensor's driver")


@pytest.mark.parametrize(
    "graph",
    [Graph(types={TOPIC: IMAGE}), Graph(subscribers={TOPIC: ("/fleetsight_gateway_r1",)})],
    ids=["published once", "subscribed"],
)
def test_a_topic_without_publishers(graph: Graph) -> None:
    look = stream("front/color", TOPIC, "")
    seen = evidence(look, master=MasterLook("http://robot:11311", graph=graph))
    (finding,) = check_sensors(seen)
    assert (finding.severity, finding.what) == (Severity.PROBLEM, "nobody publishes it")


def test_a_type_that_the_stream_cannot_carry() -> None:
    finding = found(sends("front/color", "/tf", TF))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == (
        "is a tf2_msgs/TFMessage, which the stream cannot carry: it carries sensor_msgs/Image or "
        "sensor_msgs/CompressedImage"
    )
    assert "ros/tf=/tf" in finding.advice


def test_a_publisher_of_another_type_than_the_master_says() -> None:
    look = stream("front/color", TOPIC, IMAGE, publisher(TF, heard()))
    assert "is a tf2_msgs/TFMessage, which the stream cannot carry" in found(look).what


@pytest.mark.parametrize("type_name", ["my_msgs/Mine", IMAGE])
def test_a_raw_stream_carries_any_type_and_version(type_name: str) -> None:
    any_version = publisher(IMAGE, heard(), type=TopicType(type_name, "0" * 32))
    assert found(stream("ros/mine", "/mine", type_name, any_version)).severity is Severity.OK


def test_transforms_by_their_older_name_are_carried() -> None:
    old = "tf/tfMessage"
    assert found(stream("tf", "/tf", old, publisher(TF, heard()))).severity is Severity.OK
    assert found(stream("tf", "/tf", TF, publisher(old, heard()))).severity is Severity.OK
    other = publisher(old, heard(), type=TopicType(old, "0" * 32))
    assert "another version of tf/tfMessage" in found(stream("tf", "/tf", TF, other)).what


def test_another_version_of_a_message() -> None:
    old = publisher(IMAGE, heard(), type=TopicType(IMAGE, "0" * 32))
    finding = found(stream("front/color", TOPIC, IMAGE, old))
    assert finding.severity is Severity.PROBLEM
    assert "another version of sensor_msgs/Image: md5sum 00000000000000000000000000000000" in finding.what
    assert "ours is 060021388200f6f0f447d0fcd9c64743" in finding.what


@pytest.mark.parametrize(
    ("failure", "what", "advice"),
    [
        (Failure.UNRESOLVED, "registered at arm, a name that does not resolve", "add arm to /etc/hosts here"),
        (Failure.UNRESOLVED, "registered at arm, a name that does not resolve", "ROS_HOSTNAME"),
        (Failure.DEAD, "is registered at arm:40000, but nothing listens", "rosnode cleanup"),
        (Failure.DEAD, "nothing listens: killed, or address wrong", "ROS_IP"),
        (Failure.UNKNOWN, "left the master", "start it again"),
        (Failure.REFUSED, "refuses its subscribers: why", "restart that node"),
        (Failure.FOREIGN, "refuses its subscribers: why", "another program"),
        (Failure.SILENT, "does not answer at arm:40000 (why)", "hang"),
        (Failure.OFF, "does not answer at arm:40000 (why)", "firewall"),
        (Failure.OFF, "does not answer at arm:40000 (why)", "ROS_IP"),
    ],
)
def test_a_publisher_that_cannot_be_heard(failure: Failure, what: str, advice: str) -> None:
    gone = PublisherLook("/arm", Trouble(failure, "arm", 40000, "why"))
    alone = found(stream("front/color", TOPIC, IMAGE, gone))
    assert alone.severity is Severity.PROBLEM
    assert alone.what.startswith("/arm ")
    assert what in alone.what
    assert advice in alone.advice


@pytest.mark.parametrize(
    ("size", "advice"),
    [
        (72_000_061, "give the gateway --max-message-mib 69 or more, or have the driver send smaller"),
        (1 << 30, "give the gateway --max-message-mib 1024 or more, or have"),
        ((1 << 30) + 1, "have the driver send smaller or compressed messages"),
    ],
)
def test_a_publisher_whose_messages_are_too_large(size: int, advice: str) -> None:
    over = Trouble(Failure.TOO_LARGE, "arm", 40000, f"a message of {size} bytes, over the limit of 9", size)
    finding = found(stream("front/color", TOPIC, IMAGE, PublisherLook("/arm", over)))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == f"/arm sends a message of {size} bytes, over the limit of 9"
    assert finding.advice.startswith(advice)


def test_a_dead_publisher_beside_a_live_one_keeps_nothing_from_flowing() -> None:
    dead = PublisherLook("/old", Trouble(Failure.DEAD, "robot", 40000))
    look = stream("front/color", TOPIC, IMAGE, dead, publisher(IMAGE, heard()))
    assert [each.severity for each in check_sensors(evidence(look))] == [Severity.NOTE, Severity.OK]


def test_a_publisher_that_sends_nothing() -> None:
    finding = found(stream("front/color", TOPIC, IMAGE, publisher(IMAGE, Heard())))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == "/camera accepts subscribers but sent nothing in 3 s"


@pytest.mark.parametrize("name", ["text/mode", "ros/mode", "tf", "tf_static"])
def test_what_speaks_only_now_and_then_may_be_silent(name: str) -> None:
    type_name = TF if name.startswith("tf") else "std_msgs/String"
    look = stream(name, f"/{name}", type_name, publisher(type_name, Heard()))
    assert found(look).severity is Severity.NOTE


def test_a_latched_topic_may_be_silent() -> None:
    look = stream("front/color", TOPIC, IMAGE, publisher(IMAGE, Heard(), latching=True))
    assert found(look).severity is Severity.NOTE


def test_a_latched_message_has_no_rate_and_its_age_means_nothing() -> None:
    old = heard(count=1, late_ms=3_600_000)
    finding = found(stream("front/color", TOPIC, IMAGE, publisher(IMAGE, old, latching=True)))
    assert (finding.severity, finding.what) == (Severity.OK, "/camera sends one latched message, 100 bytes each")


@pytest.mark.parametrize("discover", [True, False])
def test_depth_that_is_used_as_colour(*, discover: bool) -> None:
    depth = replace(heard(), unreadable="32FC1 pixels are depth, not colour")
    look = stream("front/color", TOPIC, IMAGE, publisher(IMAGE, depth))
    seen = check_sensors(evidence(look, discover=discover))
    (finding,) = (each for each in seen if each.subject == look.subject)
    assert finding.severity is Severity.PROBLEM
    assert finding.what == "/camera sends depth, which is used as colour: 32FC1 pixels are depth, not colour"
    options = f"{'--discover ' if discover else ''}--topics front/depth={TOPIC}"
    assert finding.advice == f"name it as depth: {options}"


def test_messages_that_cannot_be_forwarded() -> None:
    bad = replace(heard(), unreadable="unknown encoding: 'rgb9'")
    finding = found(stream("front/color", TOPIC, IMAGE, publisher(IMAGE, bad)))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == "/camera sends messages that cannot be forwarded: unknown encoding: 'rgb9'"


def test_what_could_be_a_sensors_but_is_not_taken_is_told_with_the_reason() -> None:
    seen = replace(evidence(color()), left_out={"/front/image_rect": "front/color is another"})
    (finding,) = (each for each in check_sensors(seen) if each.severity is Severity.NOTE)
    assert (finding.subject, finding.what) == ("/front/image_rect", "not taken: front/color is another")


def test_options_for_streams_that_there_are_not_are_told() -> None:
    seen = replace(evidence(color()), unused=["--max-hz fornt/color"])
    (finding,) = (each for each in check_sensors(seen) if each.severity is Severity.NOTE)
    assert (finding.subject, finding.what) == ("--max-hz fornt/color", "there is no such stream")
