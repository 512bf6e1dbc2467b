"""The options that reasons for leaving topics out name are given to a gateway as they stand."""

import re
from collections.abc import Iterator

import pytest

from gateway.discovery import DiscoverySettings, Plan, plan
from gateway.discovery.published_topics import Topic
from gateway.settings import GatewaySettings
from services.toolbox.settings import load
from tests.gateway.discovery.graphs import DRIVERS, IMAGE, POINTS, TF, graph, mapping

ODD = {
    IMAGE: "/thermal /front/camera/image_raw /rear/camera/image_raw /debug/image_raw",
    POINTS: "/laser/scan3d",
    TF: "/tf",
    "std_msgs/String": "/mode",
    "sensor_msgs/BatteryState": "/battery",
}


def options_in(reason: str, topic: Topic) -> Iterator[list[str]]:
    """Yield the command line of each way that a reason names, with what stands for names filled in."""
    stream = "points" if topic.type == POINTS else "color"
    for option, value in re.findall(r"--discover (--\w+) (\S+)", reason):
        if option != "--cameras" or stream == "color":
            named = value.replace("NAME", "extra").replace("STREAM", stream).replace("TOPIC", topic.name)
            yield ["--discover", option, named]


def planned(topics: list[Topic], options: list[str]) -> Plan:
    given = ["--robot", "r1", "--ros-host", "robot", *options]
    return plan(topics, load(GatewaySettings, given, prog="fleetsight gateway").settings.discovery_settings())


@pytest.mark.parametrize("published", [*(each for each, _ in DRIVERS.values()), ODD], ids=[*DRIVERS, "odd"])
def test_a_topic_that_is_left_out_is_taken_as_the_reason_says_beside_all_others(published: dict[str, str]) -> None:
    topics = graph(published)
    before = plan(topics, DiscoverySettings("r1"))
    for topic in topics:
        reason = before.left_out.get(topic.name, "")
        followed = list(options_in(reason, topic))
        assert bool(followed) == ("takes it" in reason)
        for options in followed:
            after = mapping(planned(topics, options))
            assert topic.name in after.values()
            assert mapping(before).items() <= after.items()
