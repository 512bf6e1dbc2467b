"""Overlays, distances, clouds, alerts and actions on a robot's real ROS 1 graph: rospy, roscpp and ROS's own tools."""

import asyncio
import json
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Reader

from bus import Publisher, QoS
from gateway.ros1 import image as ros_image
from gateway.ros1 import point_cloud as ros_point_cloud
from gateway.ros1.image import decode_image
from gateway.ros1.master import MasterClient
from gateway.ros1.messages import message_type
from gateway.ros1.point_cloud import decode_point_cloud
from gateway.ros1.wire.tcpros import SubscriberConnection
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.to_ros.outputs import STRING
from gateway.to_ros.stream import REFUSED, SLOW, UNHEARD
from gateway.to_ros.world import MARKERS, OBJECTS_TOPIC, OBSTACLES_TOPIC, marker_id, outline
from schemas import codec
from schemas.keys import ACTIONS, ALERTS, NEARBY, CameraKey, RobotStreamKey, Stream
from schemas.world import WorldObject
from tests.gateway.to_ros.lists import class_list
from tests.gateway.to_ros.overlays import BLUE, RED, overlay
from tests.gateway.to_ros.test_world import NOW_NS, nearby
from tests.gateway.to_ros.test_world import known as known_object
from tests.integration.detecting import results
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.peers.ros import PEERS, RosEnvironment, RosProcess, require_ros
from tests.integration.peers.rospy_scripts import BAG_SUMMARY
from tests.schemas.results import action, alert, cloud, clouds, distances, known, unknown
from tests.waiting import until

FRONT = CameraKey("r1", "front")
CAMERAS = {"front": "/front/color/image_raw"}
CLASSES, DISTANCE = "/ultralytics/detection/classes", "/ultralytics/detection/distance"
DETECTION, SEGMENTATION = "/ultralytics/detection/image", "/ultralytics/segmentation/image"
POINTS, ALERTS_TOPIC, PICK_UP = "/ultralytics/segmentation/points", "/ultralytics/alerts", "/planner/pick_up"
TYPES = {
    CLASSES: STRING,
    DISTANCE: STRING,
    DETECTION: ros_image.TYPE_NAME,
    SEGMENTATION: ros_image.TYPE_NAME,
    POINTS: ros_point_cloud.TYPE_NAME,
}
AROUND = {f"/{OBSTACLES_TOPIC}": ros_point_cloud.TYPE_NAME, f"/{OBJECTS_TOPIC}": MARKERS}
MADE: dict[Stream, Callable[[int], codec.Message]] = {
    Stream.CLASSES: lambda seq: class_list(("box", 2), seq=seq),
    Stream.DISTANCES: lambda seq: distances(known("box", 2.3125), unknown("forklift"), known("pallet", 4.02), seq=seq),
    Stream.OVERLAY_DETECTION: lambda seq: overlay(seq=seq),
    Stream.OVERLAY_SEGMENTATION: lambda seq: overlay(seq=seq, height=32),
    Stream.OBJECTS: lambda seq: clouds(cloud((0.5, 0.25, 2.0), (1.5, 0.25, 2.0), label=2, index=1), seq=seq),
}
LISTENER = (PEERS / "rospy_returns.py").read_text(encoding="utf-8")
TOLERANCE = 12
"""How far JPEG takes a colour from itself."""


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


@asynccontextmanager
async def detecting(rig: FleetRig, *streams: Stream) -> AsyncIterator[dict[Stream, Publisher]]:
    """Publish some of the front camera's results."""
    async with AsyncExitStack() as stack:
        yield {name: await stack.enter_async_context(results(rig.bus, FRONT, name, MADE[name])) for name in streams}


@asynccontextmanager
async def sending(rig: FleetRig, stream: str, schema: type[codec.Message]) -> AsyncIterator[Publisher]:
    """Be the fleet's monitor."""
    key = str(RobotStreamKey("r1", stream))
    async with rig.bus.publisher(key, QoS.RESULT, encoding=codec.encoding(schema)) as publisher:
        yield publisher


async def listen(ros: RosEnvironment, *topics: str) -> RosProcess:
    """Start a rospy node that subscribes to topics; those of no result are texts."""
    named = (f"{topic}={(TYPES | AROUND).get(topic, STRING).partition('/')[2]}" for topic in topics)
    listener = await ros.script(LISTENER, *named)
    await listener.until_output("listener up")
    return listener


def heard(listener: RosProcess, topic: str) -> list[dict[str, Any]]:
    """Return what a listener has printed of a topic."""
    lines = [line for line in listener.output.split("\n")[:-1] if line.startswith("{")]
    return [found for found in map(json.loads, lines) if found["topic"] == topic]


async def one_heard(listener: RosProcess, topic: str) -> dict[str, Any]:
    await until(lambda: heard(listener, topic), f"{topic} is heard")
    return heard(listener, topic)[0]


def like(color: Sequence[int], other: Sequence[int]) -> bool:
    return all(abs(one - two) <= TOLERANCE for one, two in zip(color, other, strict=True))


@pytest.mark.timeout(120)
async def test_a_rospy_node_gets_everything_and_ros_tools_see_it(ros: RosEnvironment, rig: FleetRig) -> None:
    require_ros("rosnode")
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    async with detecting(rig, *MADE) as publishers:
        await rig.return_status("r1", "front", lambda status: not status.wanted)
        assert not any(publisher.wanted for publisher in publishers.values())
        listener = await listen(ros, *TYPES)
        assert (await one_heard(listener, CLASSES))["data"] == "['box', 'box']"
        assert (await one_heard(listener, DISTANCE))["data"] == "['box: 2.31m', 'pallet: 4.02m']"
        for topic, height in ((DETECTION, 48), (SEGMENTATION, 32)):
            image = await one_heard(listener, topic)
            assert (image["seq"], image["frame_id"]) == (1, "camera_color_optical_frame")
            assert 0 <= image["stamp"] - 1_700_000_000_000_000_000 < 1_000
            assert (image["height"], image["width"], image["encoding"]) == (height, 64, "rgb8")
            assert image["bytes"] == height * 64 * 3
            assert like(image["first"], RED)
            assert like(image["last"], BLUE)
        points = await one_heard(listener, POINTS)
        assert points["points"] == [[0.5, 0.25, 2.0, 2, 1], [1.5, 0.25, 2.0, 2, 1]]
        assert (points["height"], points["width"], points["frame_id"]) == (1, 2, "camera_color_optical_frame")
        await tools_see(ros)
        await listener.end()
        await until(lambda: not any(p.wanted for p in publishers.values()), "the listener's end ends the demand")


async def tools_see(ros: RosEnvironment) -> None:
    hz, echo, info, listed = await asyncio.gather(
        ros.rostopic("hz", SEGMENTATION),
        ros.rostopic("echo", "-n", "1", "--noarr", POINTS),
        ros.rostopic("info", DETECTION),
        ros.rostopic("list", "-v"),
    )
    assert f"Type: {ros_image.TYPE_NAME}" in await info.finished()
    listing = await listed.finished()
    for topic, kind in TYPES.items():
        assert f" * {topic} [{kind}] 1 publisher" in listing
    assert "point_step: 24" in await echo.finished()
    await hz.until_output("average rate:")
    await hz.end()
    nodes = await (await ros.run("/usr/bin/rosnode", "list")).finished()
    gateway = next(name for name in nodes.split() if name.startswith("/fleetsight_gateway_r1_"))
    node = await (await ros.run("/usr/bin/rosnode", "info", gateway)).finished()
    assert "Pid: " in node
    assert f" * {POINTS} [{ros_point_cloud.TYPE_NAME}]" in node
    assert " * to: /returns_listener" in node
    assert "    * direction: outbound" in node


@pytest.mark.timeout(120)
async def test_a_recorded_bag_reads_back_with_its_definitions(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    bag = tmp_path / "returned.bag"
    async with detecting(rig, *MADE):
        recording = await ros.run("/usr/bin/rosbag", "record", f"--output-name={bag}", *TYPES)
        for stream in MADE:
            await rig.return_status("r1", "front", lambda status: status.published >= 5, stream=stream)
        await recording.end()
    with Reader(bag) as reader:
        found = {connection.topic: (connection, data) for connection, _, data in reader.messages()}
    assert set(found) == set(TYPES)
    for topic, name in TYPES.items():
        kind, (connection, _) = message_type(name), found[topic]
        assert (connection.digest, connection.msgdef.data) == (kind.md5sum, kind.definition)
    assert decode_image(found[DETECTION][1]).data.nbytes == 48 * 64 * 3
    assert [field.name for field in decode_point_cloud(found[POINTS][1]).fields][-2:] == ["label", "instance"]
    summary = await (await ros.script(BAG_SUMMARY, str(bag))).finished()
    read = {topic: (connection, *rest) for topic, connection, *rest in map(json.loads, summary.splitlines())}
    for topic, name in TYPES.items():
        kind, (header, definition, size) = message_type(name), read[topic]
        assert header == {"type": name, "md5sum": kind.md5sum, "message_definition": kind.definition}
        assert definition.strip() == kind.definition.strip()
        assert size > 0
    await played_again(ros, bag)


async def played_again(ros: RosEnvironment, bag: Path) -> None:
    """Play the bag to a rospy node under other names."""
    listener = await ros.script(LISTENER, f"/again{CLASSES}=String", f"/again{DETECTION}=Image")
    await listener.until_output("listener up")
    await ros.run("/usr/bin/rosbag", "play", "--quiet", "--loop", "--prefix=/again", str(bag))
    assert (await one_heard(listener, f"/again{CLASSES}"))["data"] == "['box', 'box']"
    image = await one_heard(listener, f"/again{DETECTION}")
    assert (image["width"], image["height"], image["encoding"]) == (64, 48, "rgb8")


@pytest.mark.timeout(120)
async def test_roscpp_nodes_pass_overlays_and_clouds_on(ros: RosEnvironment, rig: FleetRig) -> None:
    relay, throttle = "/usr/lib/topic_tools/relay", "/usr/lib/topic_tools/throttle"
    require_ros(relay, throttle)
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    async with detecting(rig, Stream.OVERLAY_DETECTION, Stream.OBJECTS):
        await ros.run(relay, DETECTION, "/relayed", "__name:=relay")
        await ros.run(throttle, "messages", POINTS, "50", "/throttled", "__name:=throttle")
        listener = await ros.script(LISTENER, "/relayed=Image", "/throttled=PointCloud2")
        image, points = await one_heard(listener, "/relayed"), await one_heard(listener, "/throttled")
    assert like(image["first"], RED)
    assert (image["width"], image["height"], image["encoding"]) == (64, 48, "rgb8")
    assert points["points"] == [[0.5, 0.25, 2.0, 2, 1], [1.5, 0.25, 2.0, 2, 1]]


@pytest.mark.timeout(120)
async def test_a_subscriber_that_never_reads_delays_nobody(ros: RosEnvironment, rig: FleetRig) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    stream, count = Stream.OVERLAY_DETECTION, 12
    encoding = codec.encoding(type(overlay()))
    async with rig.bus.publisher(FRONT.stream(stream), QoS.IMAGE, encoding=encoding) as detector:
        await rig.return_status("r1", "front", stream=stream)
        listener = await listen(ros, DETECTION)
        async with never_reading(ros.master_uri, DETECTION):
            status = await rig.return_status("r1", "front", lambda status: status.subscribers == 2, stream=stream)
            assert status.published == 0
            for seq in range(count):
                detector.put(codec.encode(overlay(seq=seq, height=1080, width=1920)))
                await until(lambda: len(heard(listener, DETECTION)) == seq + 1, f"{seq} is heard")  # noqa: B023
            status = await rig.return_status("r1", "front", lambda status: status.published == count, stream=stream)
    assert [image["seq"] for image in heard(listener, DETECTION)] == list(range(1, count + 1))
    assert set(status.dropped) == {SLOW}


@asynccontextmanager
async def never_reading(master_uri: str, topic: str) -> AsyncIterator[None]:
    """Subscribe as a node that hangs."""
    loop = asyncio.get_running_loop()
    async with XmlRpcClient() as client:
        master = MasterClient(client, uri=master_uri, caller_id="/hanging")
        (publisher,) = (await master.get_system_state()).publishers[topic]
        uri = await master.lookup_node(publisher)
        _, host, port = await client.call(uri, "requestTopic", "/hanging", topic, [["TCPROS"]])
    header = SubscriberConnection(callerid="/hanging", topic=topic, expected=message_type(TYPES[topic]).topic_type)
    with socket.socket() as connection:
        connection.setblocking(False)  # noqa: FBT003 - socket's own signature
        await loop.sock_connect(connection, (host, port))
        await loop.sock_sendall(connection, header.opening)
        yield


@pytest.mark.timeout(120)
async def test_alerts_are_json_and_latched_and_only_allowed_actions_reach_the_planner(
    ros: RosEnvironment, rig: FleetRig
) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS, "--actions", f"pick_up={PICK_UP},stop=/planner/stop")
    async with sending(rig, ALERTS, type(alert())) as alerts, sending(rig, ACTIONS, type(action())) as actions:
        await until(lambda: actions.wanted, "the gateway takes actions")
        actions.put(codec.encode(action(id_="1", name="dance")))
        actions.put(codec.encode(action(id_="2", name="stop")))
        await rig.return_status("r1", "", lambda of: of.dropped == {REFUSED: 1, UNHEARD: 1}, stream="actions")
        assert not alerts.wanted
        listener = await listen(ros, ALERTS_TOPIC, PICK_UP)
        await rig.return_status("r1", "", lambda of: of.subscribers == 1, stream="actions")
        actions.put(codec.encode(action(id_="3", payload="the box at dock 4")))
        assert (await one_heard(listener, PICK_UP))["data"] == "the box at dock 4"
        await until(lambda: alerts.wanted, "alerts are wanted")
        alerts.put(codec.encode(alert(text="a forklift is near")))
        said = json.loads((await one_heard(listener, ALERTS_TOPIC))["data"])
        assert (said["severity"], said["state"], said["text"]) == ("warning", "raised", "a forklift is near")
        late = await listen(ros, ALERTS_TOPIC)
        assert json.loads((await one_heard(late, ALERTS_TOPIC))["data"]) == said
    assert "/planner/dance" not in await (await ros.rostopic("list")).finished()


async def tell(world: Publisher, *objects: WorldObject) -> None:
    """Say again and again what is near, as the world model does."""
    for number in range(1_000):
        world.put(codec.encode(nearby(*objects, sent_ns=NOW_NS + number)))
        await asyncio.sleep(0.1)


@pytest.mark.timeout(120)
async def test_what_is_near_is_obstacles_and_markers_while_somebody_listens(ros: RosEnvironment, rig: FleetRig) -> None:
    await rig.gateway("r1", ros.master_uri, CAMERAS)
    async with sending(rig, NEARBY, type(nearby())) as world:
        await rig.return_status("r1", "", lambda of: not of.wanted, stream="nearby")
        assert not world.wanted
        listener = await listen(ros, f"/{OBSTACLES_TOPIC}", f"/{OBJECTS_TOPIC}")
        await until(lambda: world.wanted, "what is near is wanted")
        pallet = known_object("a-1")
        telling = asyncio.create_task(tell(world, pallet, known_object("a-2", at=(7.0, 1.0, 0.5))))
        cloud_of = await one_heard(listener, f"/{OBSTACLES_TOPIC}")
        assert (cloud_of["frame_id"], len(cloud_of["points"])) == ("map", 2 * len(outline(pallet)))
        markers = (await one_heard(listener, f"/{OBJECTS_TOPIC}"))["markers"]
        telling.cancel()
        assert {(each["ns"], each["id"]) for each in markers if not each["text"]} == {
            ("pallet", marker_id("a-1")),
            ("pallet", marker_id("a-2")),
        }
        assert {each["text"] for each in markers} == {"", "pallet a-1", "pallet a-2"}
