"""Examines the robot's ROS graph: the master, and all publishers of relevant topics at once."""

import asyncio
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final
from urllib.parse import urlsplit

from gateway.discovery import Plan, plan, unclear
from gateway.discovery.plan import INFOS, OF_GATEWAYS, TYPES
from gateway.discovery.published_topics import calibrations_of, topics_of
from gateway.doctor.evidence import Failure, Graph, MasterLook, PublisherLook, StreamLook, Trouble
from gateway.doctor.reachability import reach, resolve, uri_of
from gateway.doctor.sensors import CLOCK
from gateway.doctor.topic_probe import FEW, ONE, TRANSFORMS, Enough, TopicProbe, listen
from gateway.ros1.addresses import parse_offer
from gateway.ros1.errors import (
    FaultError,
    InvalidNameError,
    LinkRefusedError,
    Ros1Error,
    StatusError,
    TooLargeError,
    UnreachableError,
)
from gateway.ros1.listening import is_local
from gateway.ros1.master import MasterClient
from gateway.ros1.sim_clock import TOPIC as SIM_CLOCK
from gateway.ros1.wire.tcpros import DEFAULT_MAX_MESSAGE_BYTES, PublisherAccepted
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.settings import GatewaySettings
from gateway.to_bus.translators import StreamKind, kind_of
from gateway.to_bus.translators.camera_info import TYPE_NAME as CAMERA_INFO
from gateway.to_bus.translators.pixel_encoding import encoding_of
from schemas.keys import ROBOT_STREAMS, TF, TF_STATIC, SensorKey, StreamKey, owner_of, sensor_key


@dataclass(slots=True)
class _Peer:
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    silence: UnreachableError | None = None


class PoliteClient(XmlRpcClient):
    """XML-RPC client that calls each server once at a time, and none again that did not answer.

    Python's ROS nodes keep five callers waiting and drop the others, who then notice nothing for a second.
    """

    def __init__(self, *, timeout: float) -> None:
        super().__init__(timeout=timeout)
        self._peers: dict[str, _Peer] = {}

    async def call(self, uri: str, method: str, *params: Any) -> Any:
        """See `XmlRpcClient.call`."""
        peer = self._peers.setdefault(uri, _Peer())
        async with peer.turn:
            if peer.silence is not None:
                raise UnreachableError(str(peer.silence)) from peer.silence.__cause__
            try:
                return await super().call(uri, method, *params)
            except UnreachableError as error:
                peer.silence = error
                raise


MAX_PUBLISHERS: Final = 16
"""Most publishers of one topic that are examined."""
MAX_AT_ONCE: Final = 64
_NO_HEADER: Final = "no connection header"


class RobotVisit:
    """One examination of a robot's ROS graph, under a unique node name that is never registered.

    seconds: how long each publisher is listened to. patience_s: how long each step may take. max_message_bytes: longer
    messages are not read.
    """

    def __init__(
        self,
        client: PoliteClient,
        *,
        seconds: float,
        patience_s: float,
        max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES,
    ) -> None:
        self._client = client
        self._seconds = seconds
        self._patience_s = patience_s
        self._max_message_bytes = max_message_bytes
        self._name = f"/fleetsight_doctor_{uuid.uuid4().hex[:8]}"
        self._room = asyncio.Semaphore(MAX_AT_ONCE)
        self._master: MasterClient | None = None
        self._reaching: dict[tuple[str, int], asyncio.Future[str | Trouble]] = {}

    async def look_at_master(self, uri: str) -> MasterLook:
        """Examine the master."""
        host, port = _host_and_port(uri)
        address = await reach(host, port, self._patience_s)
        if isinstance(address, Trouble):
            return MasterLook(uri, address)
        remote = not is_local(address)
        master = MasterClient(self._client, uri=uri_of(address, port), caller_id=self._name)
        try:
            state = await master.get_system_state()
            graph = Graph(state.publishers, state.subscribers, await master.get_topic_types())
            sim_time = await master.uses_sim_time()
        except Ros1Error as error:
            return MasterLook(uri, _trouble(error, host, port), remote=remote)
        self._master = master
        return MasterLook(uri, None, graph, remote, sim_time)

    async def look_at_streams(
        self,
        streams: Mapping[SensorKey, str],
        graph: Graph,
        carried: Callable[[SensorKey], StreamKind] = kind_of,
    ) -> tuple[StreamLook, ...]:
        """Examine all publishers of these topics. carried: returns the kind of a stream.

        Streams of one topic share its connections: a rospy node ends the older of two from one subscriber.
        """
        by_topic: dict[str, dict[SensorKey, StreamKind]] = {}
        for key, topic in streams.items():
            by_topic.setdefault(topic, {})[key] = carried(key)
        looks = await asyncio.gather(*(self._look_at_topic(*each, graph) for each in by_topic.items()))
        found = {look.key: look for each in looks for look in each}
        return tuple(found[key] for key in streams)

    async def encodings(self, topics: Sequence[str], graph: Graph) -> dict[str, str]:
        """Return the pixel encodings of the images whose first message comes in time."""
        found = await asyncio.gather(*(self._encoding(topic, graph) for topic in topics))
        return {topic: encoding for topic, encoding in zip(topics, found, strict=True) if encoding}

    async def _encoding(self, topic: str, graph: Graph) -> str:
        for node in graph.publishers.get(topic, ())[:MAX_PUBLISHERS]:
            with suppress(Ros1Error, ValueError):
                slave = _host_and_port(await self._registered(node))
                async with self._room:
                    heard = await self._listen(topic, slave, ONE)
                if not isinstance(heard, Trouble) and heard[0].kept:
                    return encoding_of(heard[0].kept[0])
        return ""

    async def _look_at_topic(self, topic: str, kinds: Mapping[SensorKey, StreamKind], graph: Graph) -> list[StreamLook]:
        """Return the look at a topic for each stream made of it. kinds: the streams' kinds."""
        nodes = graph.publishers.get(topic, ())[:MAX_PUBLISHERS]
        enough = TRANSFORMS if any(key.name in ROBOT_STREAMS for key in kinds) else FEW
        seen = await asyncio.gather(*(self._look_at_publisher(topic, node, enough) for node in nodes))
        now_ns = time.time_ns()
        return [
            StreamLook(
                key,
                topic,
                graph.types.get(topic, ""),
                tuple(replace(look, heard=probe.heard(key, kind, now_ns)) if probe else look for look, probe in seen),
                kind,
            )
            for key, kind in kinds.items()
        ]

    async def _look_at_publisher(
        self, topic: str, node: str, enough: Enough
    ) -> tuple[PublisherLook, TopicProbe | None]:
        """Return the look at a publisher, with its messages if it accepts the connection."""
        try:
            host, port = _host_and_port(await self._registered(node))
        except (Ros1Error, ValueError) as error:
            return PublisherLook(node, Trouble(Failure.UNKNOWN, node, 0, str(error))), None
        async with self._room:
            try:
                heard: tuple[TopicProbe, PublisherAccepted] | Trouble = await self._listen(topic, (host, port), enough)
            except Ros1Error as error:
                heard = _trouble(error, host, port)
        if isinstance(heard, Trouble):
            return PublisherLook(node, heard), None
        probe, publisher = heard
        return PublisherLook(node, None, publisher.type, publisher.latching), probe

    async def _registered(self, node: str) -> str:
        if self._master is None:
            raise RuntimeError("the master is looked at first")
        return await self._master.lookup_node(node)

    async def _listen(
        self, topic: str, slave: tuple[str, int], enough: Enough
    ) -> tuple[TopicProbe, PublisherAccepted] | Trouble:
        """Listen to a publisher until enough messages came or time is up."""
        address = await self._reached(*slave)
        if isinstance(address, Trouble):
            return address
        uri = uri_of(address, slave[1])
        host, port = parse_offer(await self._client.call(uri, "requestTopic", self._name, topic, [["TCPROS"]]))
        found = await resolve(host, self._patience_s)
        if not found:
            return Trouble(Failure.UNRESOLVED, host, port)
        target = address if address in found else found[0]  # a name such as localhost has several addresses
        probe = TopicProbe(uri, enough)
        try:
            await listen(
                (target, port),
                topic,
                probe,
                callerid=self._name,
                seconds=self._seconds,
                patience_s=self._patience_s,
                max_message_bytes=self._max_message_bytes,
            )
        except Ros1Error as error:
            return _trouble(error, host, port, silence=_NO_HEADER)
        return (probe, probe.publisher) if probe.publisher else Trouble(Failure.SILENT, host, port, _NO_HEADER)

    async def _reached(self, host: str, port: int) -> str | Trouble:
        """Return the address at which a node answers; each node is tried once, however many topics it has."""
        if (host, port) not in self._reaching:
            self._reaching[host, port] = asyncio.ensure_future(reach(host, port, self._patience_s))
        return await self._reaching[host, port]


def _host_and_port(uri: str) -> tuple[str, int]:
    """Return host and port of a URI; raise ValueError unless it has both."""
    parts = urlsplit(uri)
    if parts.scheme != "http" or not parts.hostname or not parts.port:
        raise ValueError(f"registered under {uri[:80]!r}, which is no address")
    return parts.hostname, parts.port


def _trouble(
    error: Ros1Error, host: str, port: int, *, silence: str = "it accepts connections but does not answer"
) -> Trouble:
    if isinstance(error, TooLargeError):
        return Trouble(Failure.TOO_LARGE, host, port, str(error), error.size)
    match error.__cause__ if isinstance(error, UnreachableError) else None:
        case TimeoutError():
            return Trouble(Failure.SILENT, host, port, silence)
        case ConnectionRefusedError():
            return Trouble(Failure.DEAD, host, port, "connection refused")
    refused = isinstance(error, LinkRefusedError | InvalidNameError | FaultError | StatusError)
    return Trouble(Failure.REFUSED if refused else Failure.FOREIGN, host, port, str(error))


NOTHING_HEARD: Final[Mapping[str, str]] = MappingProxyType({})


def planned(settings: GatewaySettings, graph: Graph, encodings: Mapping[str, str] = NOTHING_HEARD) -> Plan:
    """Return the plan of a gateway started now with these settings. encodings: of images, by topic."""
    topics = topics_of(graph.publishers, graph.types)
    return plan(
        [replace(each, encoding=encodings.get(each.name, "")) for each in topics], settings.discovery_settings()
    )


def to_sample(settings: GatewaySettings, graph: Graph) -> list[str]:
    """Return the image topics that the gateway samples before planning."""
    return [topic.name for topic in unclear(topics_of(graph.publishers, graph.types), settings.discovery_settings())]


def undiscovered(settings: GatewaySettings, graph: Graph) -> list[str]:
    """Return the topics that discovery would add to the named ones."""
    if settings.discover:
        return []
    discovery_settings = replace(settings.discovery_settings(), discover=True)
    found = plan(topics_of(graph.publishers, graph.types), discovery_settings).streams
    return sorted({source.topic for source in found.values()} - set(discovery_settings.named.values()))


def left_out(found: Plan, graph: Graph) -> Mapping[str, str]:
    """Return by name why topics of sensors' types are not taken."""
    return {
        topic: why for topic, why in found.left_out.items() if graph.types.get(topic) in TYPES and why != OF_GATEWAYS
    }


def beside(streams: Mapping[SensorKey, str], graph: Graph, *, sim_time: bool) -> Mapping[SensorKey, str]:
    """Return related topics: calibrations, transforms and the simulation's clock."""
    robot = next((owner_of(key)[0] for key in streams), "")
    found: dict[SensorKey, str] = dict(_calibrations(streams, graph))
    for name in (TF, TF_STATIC):
        if f"/{name}" in graph.publishers and robot:
            found[sensor_key(robot, name)] = f"/{name}"
    if sim_time and robot:
        found[sensor_key(robot, CLOCK)] = SIM_CLOCK
    return {key: topic for key, topic in found.items() if key not in streams}


def _calibrations(streams: Mapping[SensorKey, str], graph: Graph) -> Iterator[tuple[SensorKey, str]]:
    taken = set(streams.values())
    for key, topic in streams.items():
        if isinstance(key, StreamKey) and key.stream in INFOS:
            infos = (name for name in calibrations_of(topic) if graph.types.get(name) == CAMERA_INFO)
            info = next((name for name in infos if name not in taken), None)
            if info is not None:
                taken.add(info)
                yield StreamKey(key.camera, INFOS[key.stream]), info
