"""Advice that names options is followed as it stands: it does what it says, and takes nothing away."""

import re
import shlex
from collections.abc import Sequence
from dataclasses import replace

import pytest

from gateway.doctor.advice import raw_name
from gateway.doctor.cameras import check_cameras
from gateway.doctor.evidence import Evidence, Graph, StreamLook
from gateway.doctor.finding import Finding
from gateway.doctor.robot import beside, left_out, planned, undiscovered
from gateway.doctor.sensors import check_sensors
from gateway.doctor.settings import DoctorSettings
from gateway.ros1.wire.tcpros import TopicType
from gateway.settings import GatewaySettings
from schemas.keys import sensor_key
from services.toolbox.settings import load
from tests.gateway.doctor.seeing import IMAGE, INFO, TF, color, color_info, depth, evidence, graph_of, heard, publisher

TOPIC, DEPTH_TOPIC, INFO_TOPIC = "/front/color/image_raw", "/front/depth/image_raw", "/front/color/camera_info"
OTHER = publisher(IMAGE, heard(), type=TopicType(IMAGE, "0" * 32))
NAMED = ["--cameras", f"front={TOPIC}"]


def settings(options: Sequence[str]) -> GatewaySettings:
    return load(DoctorSettings, ["--robot", "r1", "--ros-host", "robot", *options], prog="fleetsight doctor").settings


def taken(graph: Graph, options: Sequence[str]) -> dict[str, str]:
    return {key.name: source.topic for key, source in planned(settings(options), graph).streams.items()}


def seen_with(options: Sequence[str], *looks: StreamLook) -> Evidence:
    """Return what the doctor sees with these options where the topics of the looks are published."""
    graph, by_topic, given = graph_of(*looks), {look.topic: look for look in looks}, settings(options)
    found = planned(given, graph)
    topics = {key: source.topic for key, source in found.streams.items()}
    further = beside(topics, graph, sim_time=False)
    streams = tuple(replace(by_topic[topic], key=key) for key, topic in topics.items())
    made = evidence(*streams, beside=tuple(replace(by_topic[topic], key=key) for key, topic in further.items()))
    return replace(
        made,
        master=replace(made.master, graph=graph),
        left_out=left_out(found, graph),
        discover=given.discover,
        by_hand=frozenset(given.streams()),
        undiscovered=undiscovered(given, graph),
    )


def said(found: Sequence[Finding], what: str) -> Finding:
    (finding,) = (each for each in found if what in each.what)
    return finding


def options_in(advice: str) -> list[str]:
    (options,) = re.findall(r"(?:--discover --topics|--topics) \S+=\S+|--discover", advice)
    return shlex.split(options)


@pytest.mark.parametrize("options", [NAMED, [*NAMED, "--topics", f"front/depth={DEPTH_TOPIC}"]])
def test_a_calibration_is_added_to_streams_that_are_named(options: list[str]) -> None:
    seen = seen_with(options, color(), depth(), color_info())
    before = taken(seen.master.graph or Graph(), options)
    if "--topics" in options:
        finding = said(list(check_cameras(seen)), "has the calibration but is not a stream")
        after = taken(seen.master.graph or Graph(), [*options, *options_in(finding.advice)])
        assert after == before | {"front/info": INFO_TOPIC}
    finding = said(list(check_sensors(seen)), "only the streams that --cameras and --topics name")
    after = taken(seen.master.graph or Graph(), [*options, *options_in(finding.advice)])
    assert after == {"front/color": TOPIC, "front/depth": DEPTH_TOPIC, "front/info": INFO_TOPIC}


def test_a_calibration_that_discovery_may_not_take() -> None:
    options = ["--deny", ".*camera_info"]
    seen = seen_with(options, color(), depth(), color_info())
    finding = said(list(check_cameras(seen)), "has the calibration but is not a stream")
    assert finding.advice == "it is denied by --deny .*camera_info: change that"


def test_a_calibration_that_is_published_where_it_is_said_is_found() -> None:
    seen = seen_with([], color(), depth())
    finding = said(list(check_cameras(seen)), "no camera info: ")
    assert f"have the driver publish {INFO_TOPIC}" in finding.advice
    assert taken(graph_of(color(), depth(), color_info()), [])["front/info"] == INFO_TOPIC


@pytest.mark.parametrize("options", [[], ["--discover", "--topics", "tf=/tf"]])
def test_a_topic_that_was_found_is_forwarded_untranslated_instead(options: list[str]) -> None:
    tf = replace(color(), key=sensor_key("r1", "tf"), topic="/tf", type=TF, publishers=(publisher(TF, heard()),))
    seen = seen_with(options, replace(color(), publishers=(OTHER,)), depth(), tf)
    finding = said(list(check_sensors(seen)), "another version of sensor_msgs/Image")
    after = taken(seen.master.graph or Graph(), [*options, *options_in(finding.advice)])
    assert after == {"front/depth": DEPTH_TOPIC, "tf": "/tf", f"ros{TOPIC}": TOPIC}


def test_a_topic_that_is_named_is_forwarded_untranslated_in_place_of_what_it_was_named() -> None:
    seen = seen_with(["--topics", f"front/depth={DEPTH_TOPIC},front/color={INFO_TOPIC}"], depth(), color_info())
    finding = said(list(check_sensors(seen)), f"is a {INFO}, which the stream cannot carry")
    assert finding.advice.endswith("in place of front/color")
    after = taken(seen.master.graph or Graph(), ["--topics", f"front/depth={DEPTH_TOPIC}", *options_in(finding.advice)])
    assert after == {"front/depth": DEPTH_TOPIC, f"ros{INFO_TOPIC}": INFO_TOPIC}


@pytest.mark.parametrize(
    ("topic", "name"),
    [
        ("/front/image_raw", "ros/front/image_raw"),
        ("/front/_private", "ros/front/private"),
        ("/robot/alive", "ros/NAME"),
        ("/budget", "ros/NAME"),
        ("/" + "x" * 65, "ros/NAME"),
    ],
)
def test_names_of_streams_that_carry_a_topic_untranslated(topic: str, name: str) -> None:
    assert raw_name(topic) == name
    GatewaySettings(robot="r1", ros_host="robot", topics={name: topic})
