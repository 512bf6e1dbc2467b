"""The visit of a ROS graph of ours, with publishers that misbehave; real ones are in the integration tests."""

import asyncio
from contextlib import AsyncExitStack
from typing import Any

import pytest

from gateway.doctor.evidence import Failure, PublisherLook, Trouble
from gateway.doctor.finding import Severity
from gateway.doctor.robot import PoliteClient, RobotVisit, planned
from gateway.doctor.sensors import check_sensors
from gateway.ros1.image import Image, encode_image
from gateway.ros1.messages import message_type, new_message, serialise
from gateway.ros1.node import Node
from gateway.ros1.wire.header import encode_header
from gateway.ros1.wire.tcpros import message_prefix
from gateway.ros1.xmlrpc.server import XmlRpcServer
from gateway.settings import GatewaySettings
from schemas.camera_info import CameraInfo
from schemas.image import ImageFrame
from schemas.keys import sensor_key
from schemas.ros import RawMessage, Text
from services.simulator.ros_master.master import RosMaster
from tests.gateway.doctor.seeing import evidence
from tests.gateway.ros1.support.fakes import FakeSlave, fake_publisher
from tests.gateway.sensing import camera_info, point_cloud
from tests.integration.peers.ros import free_port
from tests.waiting import until

STRING = "std_msgs/String"
CHAT = {sensor_key("r1", "text/chat"): "/chat"}


TEXT = serialise(STRING, new_message(STRING, data="hello"))


def visit(client: PoliteClient) -> RobotVisit:
    return RobotVisit(client, seconds=0.5, patience_s=client._timeout)


async def register(client: PoliteClient, master: RosMaster, uri: str, name: str = "/talker") -> None:
    await client.call(master.uri, "registerPublisher", name, "/chat", STRING, uri)


async def look(client: PoliteClient, master: RosMaster) -> tuple[PublisherLook, ...]:
    """Return what is seen of the chat's publishers."""
    visiting = visit(client)
    seen = await visiting.look_at_master(master.uri)
    assert seen.graph is not None
    (stream,) = await visiting.look_at_streams(CHAT, seen.graph)
    assert stream.type == STRING
    return stream.publishers


def chat(*messages: bytes) -> bytes:
    kind = message_type(STRING)
    fields = {"type": kind.name, "md5sum": kind.md5sum, "callerid": "/talker", "message_definition": kind.definition}
    return encode_header(fields) + b"".join(message_prefix(len(each)) + each for each in messages)


async def test_a_publisher_that_speaks_leaves_no_trace_at_the_master(client: PoliteClient, master: RosMaster) -> None:
    async with Node("/talker", master_uri=master.uri) as node, node.advertise("/chat", STRING) as publication:

        async def talk() -> None:
            while True:
                publication.publish(TEXT)
                await asyncio.sleep(0.01)

        talking = asyncio.create_task(talk())
        await until(lambda: node.registered, "the talker is registered")
        before = await client.call(master.uri, "getSystemState", "/test")
        (seen,) = await look(client, master)
        assert await client.call(master.uri, "getSystemState", "/test") == before
        talking.cancel()
    assert (seen.node, seen.trouble, seen.type, seen.latching) == (
        "/talker",
        None,
        message_type(STRING).topic_type,
        False,
    )
    assert isinstance(seen.heard.message, Text)
    assert seen.heard.message.text == "hello"
    assert (seen.heard.size, seen.heard.stamps_ns) == (len(TEXT), ())
    assert len(seen.heard.arrivals_s) > 1


async def test_streams_are_read_as_the_gateway_makes_them(client: PoliteClient, master: RosMaster) -> None:
    rgb = new_message("sensor_msgs/PointField", name="rgb", offset=4, datatype=7, count=1)
    info = camera_info(P=[2.0, 0, 3, 0, 0, 2, 3, 0, 0, 0, 1, 0])
    picture = encode_image(Image(1, 1, 0, "lens", 1, 2, "mono8", is_bigendian=False, step=2, data=memoryview(b"ab")))
    said = {
        "/front/depth_registered/points": ("sensor_msgs/PointCloud2", bytes(point_cloud(fields=[rgb]).data)),
        "/rear/image_rect_color": ("sensor_msgs/Image", picture),
        "/rear/camera_info": ("sensor_msgs/CameraInfo", bytes(info.data)),
    }
    async with Node("/driver", master_uri=master.uri) as node, AsyncExitStack() as stack:
        for topic, (name, message) in said.items():
            publication = await stack.enter_async_context(node.advertise(topic, name, latch=True))
            publication.publish(message)
        await until(lambda: node.registered, "it is registered")
        visiting = visit(client)
        seen = await visiting.look_at_master(master.uri)
        assert seen.graph is not None
        found = planned(GatewaySettings(robot="r1", ros_host="robot"), seen.graph)
        topics = {key: source.topic for key, source in found.streams.items()}
        looks = await visiting.look_at_streams(topics, seen.graph, found.kind_of)
    by_name = {each.name: each for each in looks}
    assert by_name.keys() == {"front/color", "front/points", "rear/color", "rear/info"}
    assert isinstance(by_name["front/color"].heard.message, ImageFrame)
    calibration = by_name["rear/info"].heard.message
    assert isinstance(calibration, CameraInfo)
    assert (calibration.d, calibration.k[0]) == ([], 2.0)
    said_of = [each for each in check_sensors(evidence(*looks)) if each.severity is Severity.PROBLEM]
    assert said_of == []


async def test_a_dead_publisher_delays_no_live_one(client: PoliteClient, master: RosMaster) -> None:
    async with fake_publisher(chat(TEXT), hang=True) as uri:
        await register(client, master, f"http://127.0.0.1:{free_port()}/", "/dead")
        await register(client, master, uri, "/live")
        dead, live = await look(client, master)
    assert dead.trouble
    assert dead.trouble.failure is Failure.DEAD
    assert isinstance(live.heard.message, Text)


@pytest.mark.parametrize(
    ("stream", "hang", "failure", "patience_s"),
    [
        pytest.param(b"", True, Failure.SILENT, 0.3, id="never sends its header"),
        pytest.param(b"", False, Failure.FOREIGN, 20, id="closes at once"),
        pytest.param(b"garbage" * 100, True, Failure.FOREIGN, 20, id="garbage"),
        pytest.param(encode_header({"error": "go away"}), True, Failure.REFUSED, 20, id="refuses"),
    ],
)
async def test_publishers_that_do_not_let_us_listen(
    client: PoliteClient, master: RosMaster, stream: bytes, failure: Failure, *, hang: bool
) -> None:
    async with fake_publisher(stream, hang=hang) as uri:
        await register(client, master, uri)
        (seen,) = await look(client, master)
    assert seen.trouble
    assert seen.trouble.failure is failure
    assert seen.heard.arrivals_s == ()


async def test_a_message_over_the_limit_is_told_with_its_size(client: PoliteClient, master: RosMaster) -> None:
    visiting = RobotVisit(client, seconds=0.5, patience_s=20, max_message_bytes=len(TEXT))
    async with fake_publisher(chat(TEXT, TEXT + b"!"), hang=True) as uri:
        await register(client, master, uri)
        seen = await visiting.look_at_master(master.uri)
        assert seen.graph is not None
        (stream,) = await visiting.look_at_streams(CHAT, seen.graph)
    trouble = stream.publishers[0].trouble
    assert trouble
    assert (trouble.failure, trouble.size) == (Failure.TOO_LARGE, len(TEXT) + 1)
    assert trouble.reason == f"a message of {len(TEXT) + 1} bytes, over the limit of {len(TEXT)}"


async def test_a_publisher_that_ends_is_told_with_what_it_sent(client: PoliteClient, master: RosMaster) -> None:
    async with fake_publisher(chat(TEXT, b"\0")) as uri:
        await register(client, master, uri)
        (seen,) = await look(client, master)
    assert len(seen.heard.arrivals_s) == 2


async def test_a_first_message_that_cannot_be_read(client: PoliteClient, master: RosMaster) -> None:
    async with fake_publisher(chat(b"\0"), hang=True) as uri:
        await register(client, master, uri)
        (seen,) = await look(client, master)
    assert "not a std_msgs/String" in seen.heard.unreadable


async def test_a_publisher_at_a_name_with_several_addresses(client: PoliteClient, master: RosMaster) -> None:
    """Localhost is ::1 too, where it does not listen."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(chat(TEXT))
        await reader.read()
        writer.close()

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as listener:
        slave = FakeSlave(lambda _method, _params: ["TCPROS", "localhost", listener.sockets[0].getsockname()[1]])
        async with XmlRpcServer(slave, host="127.0.0.1") as server:
            await register(client, master, server.uri)
            (seen,) = await look(client, master)
    assert isinstance(seen.heard.message, Text)


@pytest.mark.parametrize(
    ("uri", "failure"),
    [
        ("http://no-such-host.invalid:4000/", Failure.UNRESOLVED),
        ("rosrpc://127.0.0.1:1/", Failure.UNKNOWN),
        ("http://127.0.0.1:99999/", Failure.UNKNOWN),
    ],
)
async def test_addresses_that_lead_nowhere(client: PoliteClient, master: RosMaster, uri: str, failure: Failure) -> None:
    await register(client, master, uri)
    (seen,) = await look(client, master)
    assert seen.trouble
    assert seen.trouble.failure is failure


@pytest.mark.parametrize(
    ("answer", "failure"),
    [
        (["TCPROS", "no-such-host.invalid", 4000], Failure.UNRESOLVED),
        (["TCPROS", "127.0.0.1", 0], Failure.REFUSED),
        ([], Failure.REFUSED),
    ],
)
async def test_offers_that_lead_nowhere(client: PoliteClient, master: RosMaster, answer: Any, failure: Failure) -> None:
    slave = FakeSlave(lambda _method, _params: answer)
    async with XmlRpcServer(slave, host="127.0.0.1") as server:
        await register(client, master, server.uri)
        (seen,) = await look(client, master)
    assert seen.trouble
    assert seen.trouble.failure is failure


async def test_an_offer_of_a_port_at_which_nothing_listens_is_told_as_offered(
    client: PoliteClient, master: RosMaster
) -> None:
    offered = free_port()
    slave = FakeSlave(lambda _method, _params: ["TCPROS", "localhost", offered])
    async with XmlRpcServer(slave, host="127.0.0.1") as server:
        await register(client, master, server.uri)
        (seen,) = await look(client, master)
    assert seen.trouble == Trouble(Failure.DEAD, "localhost", offered, "connection refused")


@pytest.mark.parametrize("patience_s", [0.3])
async def test_a_publisher_that_hangs_is_asked_for_one_topic_only(client: PoliteClient, master: RosMaster) -> None:
    calls: list[str] = []

    async def hang(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if await reader.read(4096):
            calls.append("asked")
        await reader.read()
        writer.close()

    async with await asyncio.start_server(hang, "127.0.0.1", 0) as server:
        uri = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/"
        topics = {sensor_key("r1", f"text/chat{n}"): f"/chat{n}" for n in range(5)}
        for topic in topics.values():
            await client.call(master.uri, "registerPublisher", "/talker", topic, STRING, uri)
        visiting = visit(client)
        seen = await visiting.look_at_master(master.uri)
        assert seen.graph is not None
        looks = await visiting.look_at_streams(topics, seen.graph)
    assert calls == ["asked"]
    for look in looks:
        assert look.publishers[0].trouble
        assert look.publishers[0].trouble.failure is Failure.SILENT


async def test_a_node_with_many_topics_is_not_asked_for_all_at_once(client: PoliteClient, master: RosMaster) -> None:
    asked = 0
    topics = {sensor_key("r1", f"text/chat{n}"): f"/chat{n}" for n in range(20)}

    def answer(_method: str, _params: tuple[Any, ...]) -> Any:
        nonlocal asked
        asked += 1
        return []

    async with XmlRpcServer(FakeSlave(answer), host="127.0.0.1") as server:
        for topic in topics.values():
            await client.call(master.uri, "registerPublisher", "/talker", topic, STRING, server.uri)
        visiting = visit(client)
        seen = await visiting.look_at_master(master.uri)
        assert seen.graph is not None
        looks = await visiting.look_at_streams(topics, seen.graph)
    assert (len(looks), asked) == (20, 20)


async def test_streams_of_one_topic_share_one_connection(client: PoliteClient, master: RosMaster) -> None:
    most = 0
    keys = (sensor_key("r1", "text/chat"), sensor_key("r1", "ros/chat"))
    async with Node("/talker", master_uri=master.uri) as node, node.advertise("/chat", STRING) as publication:

        async def talk() -> None:
            nonlocal most
            while True:
                publication.publish(TEXT)
                most = max(most, publication.subscriber_count)
                await asyncio.sleep(0.01)

        talking = asyncio.create_task(talk())
        await until(lambda: node.registered, "the talker is registered")
        visiting = visit(client)
        seen = await visiting.look_at_master(master.uri)
        assert seen.graph is not None
        looks = await visiting.look_at_streams(dict.fromkeys(keys, "/chat"), seen.graph)
        talking.cancel()
    assert most == 1
    assert tuple(look.key for look in looks) == keys
    messages = [look.publishers[0].heard.message for look in looks]
    assert (type(messages[0]), type(messages[1])) == (Text, RawMessage)
