"""A robot's ROS graph that comes and goes under a gateway: masters that restart, publishers that are killed."""

import asyncio
import time
from base64 import b64encode
from collections.abc import AsyncIterator, Callable

import numpy as np
import pytest

from bus import Publisher, QoS, Subscription
from gateway.node_names import is_gateway
from gateway.ros1.master import MasterClient
from gateway.ros1.node import Node
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.to_bus.stream import MALFORMED
from schemas import codec
from schemas.detections import ClassList
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from schemas.status import StreamStatus
from tests.gateway.to_ros.lists import class_list
from tests.integration.fleet import FleetRig, fleet_rig, receive
from tests.integration.peers.ros import RosEnvironment, RosProcess
from tests.integration.peers.rospy_scripts import GREY_CAMERA, LISTENER, TALKER
from tests.schemas.pictures import file_of
from tests.waiting import PATIENCE_S

FRONT = CameraKey("r1", "front")
TOPIC = "/front/color/image_raw"
CLASSES_TOPIC = "/ultralytics/detection/classes"
RESTARTS = 10
JPEG = file_of(np.zeros((4, 6, 3), np.uint8), ".jpg")


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def camera(ros: RosEnvironment, name: str, grey: int) -> RosProcess:
    started = await ros.script(GREY_CAMERA, name, TOPIC, str(grey))
    await started.until_output("camera up")
    return started


async def seen(frames: Subscription, *greys: int) -> None:
    """Wait until a frame of each of these greys has come that the gateway received after this was called."""
    begun_ns, missing = time.time_ns(), set(greys)
    while missing:
        frame = await receive(frames, ImageFrame)
        if frame.header.received_ns > begun_ns:
            missing.discard(frame.data[0])


async def stream(rig: FleetRig, until: Callable[[StreamStatus], bool]) -> StreamStatus:
    return await rig.stream_status("r1", "front", until)


async def publishing(publisher: Publisher) -> None:
    """Publish class lists of ever newer frames, each naming its number."""
    seq = 0
    while True:
        publisher.put(codec.encode(class_list((f"n{seq}", 1), seq=seq)))
        seq += 1
        await asyncio.sleep(0.05)


async def test_a_master_that_is_killed_ten_times_in_a_row_stops_nothing(ros: RosEnvironment, rig: FleetRig) -> None:
    """Rospy does not register again at a new master, so the camera and the first listener are unknown to it."""
    old = await camera(ros, "old", 10)
    await rig.gateway("r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw")
    encoding = codec.encoding(ClassList)
    async with (
        rig.subscribed(FRONT.stream(Stream.COLOR)) as frames,
        rig.bus.publisher(FRONT.stream(Stream.CLASSES), QoS.RESULT, encoding=encoding) as classes,
        asyncio.TaskGroup() as group,
    ):
        results = group.create_task(publishing(classes))
        await seen(frames, 10)
        before = await ros.script(LISTENER, "before", CLASSES_TOPIC)
        await before.until_output("heard ['n")
        for _ in range(RESTARTS):
            await ros.end_master()
            await seen(frames, 10)
            await ros.start_master()
        await camera(ros, "new", 20)
        await seen(frames, 10, 20)
        after = await ros.script(LISTENER, "after", CLASSES_TOPIC)
        await after.until_output("heard ['n")
        newest = after.output.rpartition("heard ")[2].strip()
        await before.until_output(newest)
        status = await stream(rig, lambda status: status.publishers == 2)
        assert (status.problem, status.dropped.get(MALFORMED)) == ("", None)
        await old.end()
        await stream(rig, lambda status: status.publishers == 1)
        await seen(frames, 20)
        results.cancel()


async def test_gateways_that_are_killed_do_not_pile_up_at_the_master(ros: RosEnvironment, rig: FleetRig) -> None:
    last = ""
    for _ in range(3):
        gateway = await rig.gateway("r1", ros.master_uri, {"front": TOPIC})
        last = await next_gateway(ros, last)
        gateway.process.kill()
        await gateway.process.wait()
    await rig.gateway("r1", ros.master_uri, {"front": TOPIC})
    await next_gateway(ros, last)


async def next_gateway(ros: RosEnvironment, last: str) -> str:
    """Wait until the master knows one gateway, and another one than the last; return its name."""
    async with XmlRpcClient() as client, asyncio.timeout(30):
        master = MasterClient(client, uri=ros.master_uri, caller_id="/test")
        while True:
            state = await master.get_system_state()
            nodes = {name for names in (*state.publishers.values(), *state.subscribers.values()) for name in names}
            gateways = [name for name in nodes if is_gateway(name)]
            if len(gateways) == 1 and gateways != [last]:
                return gateways[0]
            await asyncio.sleep(0.1)


async def test_publishers_that_are_killed_and_stay_registered_delay_nobody_and_may_come_back(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    cameras = [await camera(ros, f"camera_{grey}", grey) for grey in (10, 20, 30)]
    await rig.gateway("r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw")
    for dead in cameras[:2]:
        dead.kill()
    async with rig.subscribed(FRONT.stream(Stream.COLOR)) as frames:
        await seen(frames, 30)
        status = await stream(
            rig, lambda status: status.publishers == 1 and status.broken_links.get("unreachable", 0) >= 2
        )
        assert "unreachable" in status.problem
        await camera(ros, "camera_10", 11)  # on another port: the master has its new address
        await seen(frames, 11, 30)
        cameras[2].kill()
        await camera(ros, "camera_30", 31)
        await seen(frames, 11, 31)
        await stream(rig, lambda status: status.publishers == 2)


async def test_a_publisher_of_a_wrong_type_costs_its_own_link_and_a_topic_may_change_its_type(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    wrong = await ros.script(TALKER, "talker", TOPIC, "50")
    await wrong.until_output("talker up")
    await rig.gateway("r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw")
    async with rig.subscribed(FRONT.stream(Stream.COLOR)) as frames:
        said = await stream(rig, lambda status: bool(status.problem))
        assert f"type mismatch: {TOPIC} is std_msgs/String [" in said.problem
        raw = await camera(ros, "camera", 10)
        await seen(frames, 10)
        await raw.end()
        await wrong.end()
        await stream(rig, lambda status: status.publishers == 0 and not status.problem)
        await ros.script(GREY_CAMERA, "camera", TOPIC, "20", b64encode(JPEG).decode())
        while (await receive(frames, ImageFrame)).format != "jpeg":
            pass


async def test_a_demand_that_blinks_leaves_the_ros_subscription_as_it_is(ros: RosEnvironment, rig: FleetRig) -> None:
    await camera(ros, "camera", 10)
    await rig.gateway("r1", ros.master_uri, {"front": TOPIC}, "--compression", "raw")
    links: list[str] = []
    for _ in range(3):
        async with rig.subscribed(FRONT.stream(Stream.COLOR)) as frames:
            await seen(frames, 10)
            links += await connections(ros)
    assert len(links) == 3
    assert len(set(links)) == 1
    await stream(rig, lambda status: not status.wanted and status.publishers == 0)
    async with asyncio.timeout(PATIENCE_S):
        while await connections(ros):  # noqa: ASYNC110 - its node learns that one is closed as it sends
            await asyncio.sleep(0.05)


async def connections(ros: RosEnvironment) -> list[str]:
    """Return the camera's connections to gateways, by id, as it tells them itself."""
    async with Node("/looking", master_uri=ros.master_uri) as looking:
        uri = await looking.master.lookup_node("/camera")
        info = await looking._client.call(uri, "getBusInfo", "/looking")
    return [str(row[0]) for row in info if row[4] == TOPIC and "gateway" in row[1]]
