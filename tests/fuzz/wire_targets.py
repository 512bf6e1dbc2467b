"""The ROS 1 wire: TCPROS headers, frames and connections, XML-RPC and the HTTP under it, and the APIs that it calls."""

from __future__ import annotations

import xmlrpc.client
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gateway.ros1.errors import (
    CallError,
    HeaderError,
    HttpError,
    LinkRefusedError,
    StatusError,
    TcprosError,
    TypeMismatchError,
    WireError,
    XmlRpcError,
)
from gateway.ros1.master import MasterClient
from gateway.ros1.resolver import Resolver
from gateway.ros1.slave import SlaveApi
from gateway.ros1.wire.framing import FrameReceiver
from gateway.ros1.wire.header import decode_header
from gateway.ros1.wire.http import ClientExchange, ServerExchange
from gateway.ros1.wire.service import ServiceConnection
from gateway.ros1.wire.tcpros import ANY, Offer, PublisherConnection, SubscriberConnection, TopicType
from gateway.ros1.wire.xmlrpc import Fault, MethodCall, MethodResponse, encode, result_of
from services.simulator.ros_master.api import MasterApi
from tests.fuzz.mutation import pieces
from tests.fuzz.odd_values import something
from tests.fuzz.target import Target
from tests.gateway.ros1.golden.messages import (
    IMAGE,
    IMAGE_MD5,
    PUBLISHER_HEADER,
    PUBLISHER_REFUSAL,
    REGISTER_PUBLISHER,
    REGISTER_PUBLISHER_RESPONSE,
    SERVICE_ANSWER,
    SERVICE_FAILURE,
    SERVICE_HEADER,
    SERVICE_REFUSAL,
    SUBSCRIBER_HEADER,
    TOPIC,
)
from tests.gateway.ros1.support.feeding import decode, events_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from random import Random

    from gateway.ros1.wire.xmlrpc import Body

IMAGE_TYPE = TopicType("sensor_msgs/Image", IMAGE_MD5)
MAX_MESSAGE_BYTES = 1 << 20
URI = "http://robot:1/"


def feed_header(data: bytes, _rng: Random) -> None:
    decode_header(data)


def feed_frames(data: bytes, rng: Random) -> None:
    frames = FrameReceiver(MAX_MESSAGE_BYTES)
    for piece in pieces(rng, data):
        rest = memoryview(piece)
        while rest:
            buffer = frames.get_buffer()
            count = min(len(buffer), len(rest))
            assert count > 0
            buffer[:count] = rest[:count]
            rest = rest[count:]
            frames.buffer_updated(count)
            while frames.next_frame() is not None:
                pass


def feed_subscriber(data: bytes, rng: Random) -> None:
    connection = SubscriberConnection(
        callerid="/ours", topic=TOPIC, expected=IMAGE_TYPE, max_message_bytes=MAX_MESSAGE_BYTES
    )
    events_of(connection, *pieces(rng, data))


def feed_publisher(data: bytes, rng: Random) -> None:
    connection = PublisherConnection(callerid="/ours", offers={TOPIC: Offer(TOPIC, IMAGE_TYPE, "uint32 height")})
    for piece in pieces(rng, data):
        connection.receive_data(piece)


def feed_service(data: bytes, rng: Random) -> None:
    connection = ServiceConnection(
        callerid="/ours", service="/good", expected=TopicType(ANY, ANY), max_response_bytes=MAX_MESSAGE_BYTES
    )
    for piece in pieces(rng, data):
        connection.receive_data(piece)
        while connection.next_event() is not None:
            pass


def feed_xmlrpc(data: bytes, _rng: Random) -> None:
    body = decode(data)
    encode(body)
    result_of(body)


class Answering:
    """Stands for a client whose every call is answered with one value."""

    def __init__(self, value: Any) -> None:
        self.resolver = Resolver()
        self._value = value

    async def call(self, *_: Any) -> Any:
        return self._value


def feed_master_answer(data: bytes, _rng: Random) -> None:
    client: Any = Answering(result_of(decode(data)))
    master = MasterClient(client, uri=URI, caller_id="/ours")
    for asked in (
        master.get_system_state(),
        master.register_subscriber(TOPIC, "*", URI),
        master.lookup_node("/a"),
        master.get_pid(),
    ):
        try:
            asked.send(None)
        except StopIteration:
            continue
        except XmlRpcError:
            continue


def feed_http_request(data: bytes, rng: Random) -> None:
    exchange = ServerExchange(MAX_MESSAGE_BYTES)
    try:
        for piece in pieces(rng, data):
            if piece and exchange.receive_data(piece) is not None:
                exchange.answer(b"<x/>")
                return
        exchange.receive_data(b"")
    except HttpError as error:
        exchange.refuse(error.status)
        raise
    except XmlRpcError:
        exchange.refuse(400)
        raise


def feed_http_answer(data: bytes, rng: Random) -> None:
    exchange = ClientExchange(host="robot:1", target="/", call=CALLS[0], max_body_bytes=MAX_MESSAGE_BYTES)
    for piece in pieces(rng, data):
        if piece and exchange.receive_data(piece) is not None:
            return
    exchange.receive_data(b"")


@dataclass
class Node:
    """What the slave API asks of a node."""

    master_uri: str = URI
    tcpros_address: tuple[str, int] = ("robot", 2)

    def publications(self) -> dict[str, str]:
        return {TOPIC: "sensor_msgs/Image"}

    def subscriptions(self) -> dict[str, str]:
        return {"/tf": "tf2_msgs/TFMessage"}

    def publishers_updated(self, topic: str, uris: Sequence[str]) -> None:
        assert isinstance(topic, str)
        assert all(isinstance(uri, str) for uri in uris)

    def bus_stats(self) -> list[Any]:
        return [[], [], []]

    def bus_info(self) -> list[Any]:
        return []

    def shutdown(self, reason: str) -> None:
        assert isinstance(reason, str)


class Nobody:
    """Whom the master tells."""

    def notify(self, uri: str, method: str, key: str, *params: Any) -> None: ...


def feed_slave(data: bytes, _rng: Random) -> None:
    call_of(SlaveApi(Node()), data)


def feed_master(data: bytes, _rng: Random) -> None:
    master = MasterApi(Nobody())
    for call in CALLS[:4]:
        master.call(call.method, call.params)
    call_of(master, data)


def call_of(api: SlaveApi | MasterApi, data: bytes) -> None:
    body = decode(data)
    if isinstance(body, MethodCall):
        message, value = api.call(body.method, body.params)
        encode(MethodResponse([1, message, value]))


CALLS = [
    MethodCall("registerPublisher", ("/ours", TOPIC, "sensor_msgs/Image", URI)),
    MethodCall("registerSubscriber", ("/ours", TOPIC, "*", URI)),
    MethodCall("setParam", ("/ours", "/limits", {"speed": 0.5, "names": ["a", True, 3]})),
    MethodCall("subscribeParam", ("/ours", URI, "/limits/speed")),
    MethodCall("unregisterPublisher", ("/ours", TOPIC, URI)),
    MethodCall("registerService", ("/ours", "/service", "rosrpc://robot:3", URI)),
    MethodCall("unregisterService", ("/ours", "/service", "rosrpc://robot:3")),
    MethodCall("lookupService", ("/ours", "/service")),
    MethodCall("lookupNode", ("/ours", "ours")),
    MethodCall("getSystemState", ("/ours",)),
    MethodCall("getPublishedTopics", ("/ours", "/camera")),
    MethodCall("getParam", ("/ours", "limits/speed")),
    MethodCall("deleteParam", ("/ours", "/limits")),
    MethodCall("searchParam", ("/ours/a/b", "limits")),
    MethodCall("requestTopic", ("/theirs", TOPIC, [["TCPROS"], ["UDPROS", b"header", "robot", 5, 1500]])),
    MethodCall("publisherUpdate", ("/master", "/tf", [URI, "http://robot:2/"])),
    MethodCall("paramUpdate", ("/master", "/limits/speed", 0.7)),
    MethodCall("getBusStats", ("/theirs",)),
    MethodCall("shutdown", ("/master", "because")),
]
ANSWERS: list[Body] = [
    MethodResponse([1, "current state", [[[TOPIC, ["/a", "/b"]]], [["/tf", ["/c"]]], []]]),
    MethodResponse([1, "", ["http://robot:1/", "http://robot:2/"]]),
    MethodResponse([1, "", ["TCPROS", "robot", 5]]),
    MethodResponse([-1, "unknown", 0]),
    MethodResponse([1, "", {"a": 1, "b": [1.5, True, "x"]}]),
    Fault(1, "no such method"),
]
OTHERS = [
    b"<methodCall><methodName>x</methodName><params><param><value><nil/></value></param></params></methodCall>",
    xmlrpc.client.dumps((xmlrpc.client.DateTime(0), b"bytes", 2**31 - 1), "x").encode(),
    b"<params><value>" + b"<array><data><value>" * 50 + b"</value></data></array>" * 50 + b"</value></params>",
    b'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><params><value>&b;</value></params>',
    b'<!DOCTYPE x SYSTEM "file:///etc/passwd"><params/>',
    b"<params><value><i8>5</i8></value><value><bigdecimal>1e999999</bigdecimal></value></params>",
]
XML_CALLS = [REGISTER_PUBLISHER, *map(encode, CALLS)]
XML_ANSWERS = [REGISTER_PUBLISHER_RESPONSE, *map(encode, ANSWERS)]
SMALL = b"\x05\x00\x00\x00hello"


def request(body: bytes, version: str = "1.1") -> bytes:
    return f"POST /RPC2 HTTP/{version}\r\nHost: robot:1\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body


def response(body: bytes) -> bytes:
    return b"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: %d\r\n\r\n" % len(body) + body


CHUNKED = b"Transfer-Encoding: chunked\r\n\r\n%x\r\n%s\r\n0\r\n\r\n"
REQUESTS = [
    *map(request, XML_CALLS[:4]),
    request(XML_CALLS[0], "1.0"),
    b"POST / HTTP/1.1\r\nHost: x\r\n" + CHUNKED % (len(XML_CALLS[0]), XML_CALLS[0]),
    b"GET / HTTP/1.1\r\nHost: x\r\nConnection: keep-alive, Upgrade\r\nUpgrade: websocket\r\n\r\n",
    b"POST / HTTP/1.1\r\nHost: x\r\nExpect: 100-continue\r\nContent-Length: 3\r\n\r\nabc",
]
RESPONSES = [
    *map(response, XML_ANSWERS[:4]),
    b"HTTP/1.0 200 OK\r\n\r\n" + XML_ANSWERS[1],
    b"HTTP/1.1 200 OK\r\n" + CHUNKED % (len(XML_ANSWERS[1]), XML_ANSWERS[1]),
    b"HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 302 Found\r\nLocation: http://robot:2/\r\nContent-Length: 0\r\n\r\n",
    b"HTTP/1.1 204 No Content\r\n\r\n",
]
HEADERS = [PUBLISHER_HEADER, PUBLISHER_REFUSAL, SUBSCRIBER_HEADER]


def odd_call(rng: Random) -> bytes:
    """Return a call with parameters that are not what the method has, or not all."""
    call = rng.choice(CALLS)
    params = list(call.params)
    for _ in range(rng.randrange(1, 3)):
        at = rng.randrange(len(params) + 1)
        params[at : at + rng.randrange(2)] = [something(rng)] * rng.randrange(2)
    return xmlrpc.client.dumps(tuple(params), call.method).encode()


def odd_answer(rng: Random) -> bytes:
    """Return an answer whose value is not what the method has."""
    value = [1, "", something(rng)] if rng.random() < 0.8 else something(rng)
    return xmlrpc.client.dumps((value,), methodresponse=True).encode()


TARGETS = [
    Target("header", [header[4:] for header in HEADERS], feed_header, (HeaderError,)),
    Target("frames", [SMALL * 3, IMAGE, SMALL + IMAGE + b"\x00\x00\x00\x00"], feed_frames, (TcprosError,)),
    Target(
        "subscriber",
        [PUBLISHER_HEADER + IMAGE, PUBLISHER_HEADER + IMAGE + IMAGE, PUBLISHER_REFUSAL],
        feed_subscriber,
        (WireError, LinkRefusedError, TypeMismatchError),
    ),
    Target("publisher", [SUBSCRIBER_HEADER], feed_publisher, (WireError,)),
    Target(
        "service",
        [SERVICE_HEADER + SERVICE_ANSWER, SERVICE_HEADER + SERVICE_FAILURE, SERVICE_REFUSAL],
        feed_service,
        (WireError, LinkRefusedError),
    ),
    Target("XML-RPC", [*XML_CALLS, *XML_ANSWERS, *OTHERS], feed_xmlrpc, (XmlRpcError, CallError), odd_answer),
    Target("master's answers", XML_ANSWERS, feed_master_answer, (XmlRpcError, CallError), odd_answer),
    Target("slave's calls", XML_CALLS, feed_slave, (XmlRpcError, StatusError, LookupError), odd_call),
    Target("master's calls", XML_CALLS, feed_master, (XmlRpcError, StatusError, LookupError), odd_call),
    Target("HTTP request", REQUESTS, feed_http_request, (HttpError, XmlRpcError)),
    Target("HTTP answer", RESPONSES, feed_http_answer, (HttpError, XmlRpcError)),
]
