"""Ten messages at a time from Debian's rospy, on topics that the gateway does not translate: all of them arrive."""

import re
from collections.abc import AsyncIterator

import pytest

from gateway.ros1.messages import deserialise
from schemas.keys import sensor_key
from schemas.ros import RawMessage, Text
from schemas.status import StreamStatus
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import RosEnvironment
from tests.integration.peers.rospy_scripts import BURSTS

ROUNDS = 5
LINES = [f"{number}" for number in range(ROUNDS * 10)]
CAMERAS = {"other": "/other/color/image_raw"}


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def accounted(rig: FleetRig) -> StreamStatus:
    return await rig.stream_status("r1", "", lambda status: status.received >= len(LINES))


@pytest.mark.timeout(120)
@pytest.mark.parametrize("options", [(), ("--uplink-mbit", "0.2")], ids=["as they come", "on a thin uplink"])
@pytest.mark.parametrize("latch", ["", "latch"])
async def test_all_of_each_burst_arrive_in_order(
    ros: RosEnvironment, rig: FleetRig, latch: str, options: tuple[str, ...]
) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--topics", "ros/log=/log", *options)
    async with rig.subscribed(str(sensor_key("r1", "ros/log"))) as samples:
        await ros.script(BURSTS, "/log", str(ROUNDS), latch)
        heard = [await receive(samples, RawMessage) for _ in LINES]
        status = await accounted(rig)
    assert [deserialise(each.type, each.data).data for each in heard] == LINES
    assert {each.latched for each in heard} == {bool(latch)}
    assert (status.received, status.forwarded, status.dropped) == (len(LINES), len(LINES), {})


@pytest.mark.timeout(120)
async def test_texts_that_a_publisher_latches_all_arrive_too(ros: RosEnvironment, rig: FleetRig) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--topics", "text/log=/log")
    async with rig.subscribed(str(sensor_key("r1", "text/log"))) as samples:
        await ros.script(BURSTS, "/log", str(ROUNDS), "latch")
        assert [(await receive(samples, Text)).text for _ in LINES] == LINES


@pytest.mark.timeout(120)
async def test_all_that_a_node_logs_arrives(ros: RosEnvironment, rig: FleetRig) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--topics", "ros/rosout=/rosout")
    async with rig.subscribed(str(sensor_key("r1", "ros/rosout"))) as samples:
        await ros.script(BURSTS, "/rosout", str(ROUNDS), "")
        logged: list[int] = []
        while len(logged) < len(LINES):
            said = await receive(samples, RawMessage)
            assert said.type == "rosgraph_msgs/Log"
            logged += [int(number) for number in re.findall(rb"line (\d+)", said.data)]
    assert logged == list(map(int, LINES))
