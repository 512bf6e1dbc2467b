"""One ROS topic on its way to one Zenoh key: numbering, translation and the account of every message. Pure."""

import logging
from collections import Counter
from collections.abc import Mapping
from typing import Final

from gateway.ros1.errors import MessageError, TypeMismatchError
from gateway.ros1.messages import ANY_TYPE, message_type
from gateway.ros1.subscriber import Message
from gateway.ros1.wire.tcpros import TopicType
from gateway.translators import StreamKind, Translate
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.keys import SensorKey, StreamKey
from schemas.status import REPLACED_BEFORE_LINK, StreamStatus

log = logging.getLogger(__name__)

MALFORMED: Final = "malformed"
MISMATCH: Final = "of a type that the stream cannot carry"


class StreamForward:
    """Turns a topic's messages into the fleet's own.

    boot_id: this gateway process. Numbers count on while nobody listens and the topic is not subscribed.
    """

    def __init__(self, key: SensorKey, topic: str, kind: StreamKind, boot_id: str) -> None:
        self.key = key
        self.topic = topic
        self.kind = kind
        self._robot, self._camera = (
            (key.camera.robot, key.camera.camera) if isinstance(key, StreamKey) else (key.robot, "")
        )
        self._boot_id = boot_id
        self._translates: dict[TopicType, Translate] = {}
        self._received = 0
        self._translated = 0
        self._dropped: Counter[str] = Counter()
        self._replaced = 0
        self._broken_links: Counter[str] = Counter()
        self.begin()

    def begin(self) -> None:
        """Start a subscription: what was kept of an earlier one's messages is forgotten."""
        self._translates = {message_type(name).topic_type: begin() for name, begin in self.kind.translators.items()}

    def take(self, message: Message, now_ns: int) -> codec.Message | None:
        """Return what a ROS message says, or None when it cannot be read, which is counted.

        now_ns: when the whole message was here, nanoseconds since the epoch.
        """
        self._received += 1
        try:
            translated = self._translate(message, self._header(now_ns))
        except TypeMismatchError as error:
            self._leave_out(MISMATCH, message, error)
            return None
        except (MessageError, SchemaError) as error:
            self._leave_out(MALFORMED, message, error)
            return None
        self._translated += 1
        return translated

    def _translate(self, message: Message, header: Header) -> codec.Message:
        kind = message.publisher.type
        translate = self._translates.get(kind) or self._translates.get(ANY_TYPE.topic_type)
        if translate is None:
            raise TypeMismatchError(f"{kind.name} [{kind.md5sum}] is none of {', '.join(self.kind.translators)}")
        if len(message.data) > self.kind.max_bytes:
            raise MessageError(f"{kind.name} of {len(message.data)} bytes, at most {self.kind.max_bytes} are read")
        return translate(message, header)

    def _leave_out(self, reason: str, message: Message, error: Exception) -> None:
        self._dropped[reason] += 1
        log.warning("%s from %s: message left out: %s", self.topic, message.callerid, error)

    def _header(self, now_ns: int) -> Header:
        return Header(
            robot=self._robot,
            camera=self._camera,
            boot_id=self._boot_id,
            seq=self._translated,
            stamp_ns=0,
            frame_id="",
            received_ns=now_ns,
        )

    def retire(self, *, replaced: int, broken_links: Mapping[str, int]) -> None:
        """Remember what only the end of an offer knows: when the stream is offered again it counts on."""
        self._replaced += replaced
        self._broken_links.update(broken_links)

    def dropped(self, replaced: int = 0) -> Counter[str]:
        """Return how many messages were dropped, by reason; `replaced` is about the current offer (see `status`)."""
        return self._dropped + Counter({REPLACED_BEFORE_LINK: self._replaced + replaced})

    def status(self, *, wanted: bool, publishers: int, replaced: int, broken_links: Mapping[str, int]) -> StreamStatus:
        """Account for every message; `replaced` is how many payloads a newer one replaced before the link.

        That and `broken_links` are about the current offer; what was told to `retire` is added.
        """
        return StreamStatus(
            camera=self._camera,
            stream=self.key.stream,
            topic=self.topic,
            wanted=wanted,
            publishers=publishers,
            received=self._received,
            forwarded=self._translated - self._replaced - replaced,
            dropped=dict(self.dropped(replaced)),
            broken_links=dict(self._broken_links + Counter(broken_links)),
        )
