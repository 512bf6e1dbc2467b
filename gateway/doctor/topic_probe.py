"""Listens to one publisher as a subscriber would, for a bounded time, without registering at the master."""

import asyncio
import struct
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from gateway.doctor.evidence import Heard
from gateway.ros1.errors import Ros1Error
from gateway.ros1.messages import ANY_TYPE, definition_of, message_type
from gateway.ros1.resolver import Resolver
from gateway.ros1.tcpros.link import run_link
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import (
    ANY,
    DEFAULT_MAX_MESSAGE_BYTES,
    MessageReceived,
    PublisherAccepted,
    SubscriberConnection,
    SubscriberEvent,
    TopicType,
)
from gateway.to_bus.translators import Repaired, StreamKind
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.keys import SensorKey, owner_of

_TIME: Final = struct.Struct("<II")
_HEADERS: Final = frozenset({"Header", "std_msgs/Header"})
_SEQ_BYTES: Final = 4


def stamp_offset(definition: str) -> int | None:
    """Return the offset of the stamp in a message of the type, or None if it does not begin with one."""
    for line in definition.splitlines():
        words = line.partition("#")[0].split()
        if line.startswith("="):
            return None
        if len(words) < 2 or "=" in line.partition("#")[0]:
            continue
        if words[0] in _HEADERS:
            return _SEQ_BYTES
        return 0 if words[0] == "time" else None
    return None


def stamp_at(data: bytes | bytearray | memoryview, offset: int) -> int | None:
    """Return the stamp at an offset in nanoseconds, or None if the message is too short."""
    if len(data) < offset + _TIME.size:
        return None
    seconds, rest = _TIME.unpack_from(data, offset)
    return int(seconds) * 1_000_000_000 + int(rest)


def translated(key: SensorKey, kind: StreamKind, message: Message, now_ns: int) -> codec.Message | str:
    """Return the gateway's translation of a message for a stream of the kind, or why there is none."""
    said = message.publisher.type
    try:
        name = said.name if said.name in kind.translators else ANY_TYPE.name
        begin = kind.translators.get(name)
        if begin is None or message_type(name).topic_type not in {said, ANY_TYPE.topic_type}:
            return ""
        if len(message.data) > kind.max_bytes:
            return f"{len(message.data)} bytes, at most {kind.max_bytes} are read"
        return begin()(message, _header(key, now_ns))
    except Repaired as error:
        return error.made
    except (Ros1Error, SchemaError) as error:
        return str(error)


def _header(key: SensorKey, now_ns: int) -> Header:
    robot, camera = owner_of(key)
    return Header(robot=robot, camera=camera, boot_id="", seq=0, stamp_ns=0, frame_id="", received_ns=now_ns)


MAX_MESSAGES: Final = 200
KEPT: Final = 4
KEPT_BYTES: Final = 32 << 20
"""Bytes of first messages kept to match two streams; the first message is always kept."""


@dataclass(frozen=True, slots=True)
class Enough:
    """Numbers of messages of a publisher that are awaited, and of first ones that are kept."""

    heard: int
    kept: int


ONE: Final = Enough(1, 1)
FEW: Final = Enough(MAX_MESSAGES, KEPT)
TRANSFORMS: Final = Enough(1_000, 1_000)
"""For transforms: each message may have other frames."""


@dataclass(slots=True)
class TopicProbe:
    """Collects the messages of one connection."""

    uri: str
    enough: Enough = FEW
    publisher: PublisherAccepted | None = None
    kept: list[Message] = field(default_factory=list)
    arrivals_s: list[float] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    lags_ns: list[int] = field(default_factory=list)
    size: int = 0
    _offset: int | None = None
    _kept_bytes: int = 0

    @property
    def full(self) -> bool:
        return len(self.arrivals_s) >= self.enough.heard

    def accepted(self, publisher: PublisherAccepted) -> None:
        self.publisher = publisher
        self._offset = stamp_offset(definition_of(publisher))

    def hear(self, data: memoryview, now_s: float, now_ns: int) -> None:
        """Note a message's arrival, on a steady clock and on the system's."""
        if self.publisher is None or self.full:
            return
        if not self.kept or (len(self.kept) < self.enough.kept and self._kept_bytes + len(data) <= KEPT_BYTES):
            self.kept.append(Message(data, self.uri, self.publisher))
            self._kept_bytes += len(data)
        self.arrivals_s.append(now_s)
        self.size = max(self.size, len(data))
        stamp_ns = None if self._offset is None else stamp_at(data, self._offset)
        if stamp_ns is not None:
            self.stamps_ns.append(stamp_ns)
            self.lags_ns.append(now_ns - stamp_ns)

    def heard(self, key: SensorKey, kind: StreamKind, now_ns: int) -> Heard:
        """Return the collected evidence, with the kept messages translated for the kind."""
        found = [translated(key, kind, message, now_ns) for message in self.kept]
        return Heard(
            tuple(self.arrivals_s),
            self.size,
            tuple(self.stamps_ns),
            tuple(self.lags_ns),
            tuple(each for each in found if not isinstance(each, str)),
            next((each for each in found if isinstance(each, str)), ""),
        )


async def listen(
    address: tuple[str, int],
    topic: str,
    probe: TopicProbe,
    *,
    callerid: str,
    seconds: float,
    patience_s: float,
    max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES,
) -> None:
    """Listen for some seconds after the publisher accepts the connection, or until it closes it.

    Raises:
        Ros1Error: there is no such connection, or the publisher does not speak TCPROS.
        TooLargeError: it sends a message of more than `max_message_bytes`.
    """
    loop = asyncio.get_running_loop()
    connection = SubscriberConnection(
        callerid=callerid, topic=topic, expected=TopicType(ANY, ANY), max_message_bytes=max_message_bytes
    )
    with suppress(TimeoutError):
        async with asyncio.timeout(2 * patience_s) as deadline:

            def take(event: SubscriberEvent) -> None:
                match event:
                    case PublisherAccepted():
                        probe.accepted(event)
                        deadline.reschedule(loop.time() + seconds)
                    case MessageReceived(data):
                        probe.hear(data, loop.time(), time.time_ns())
                        if probe.full:
                            deadline.reschedule(loop.time())

            await run_link(address, connection, take, resolver=Resolver(), handshake_timeout=patience_s)
