"""Turns one ROS topic into one stream: translation, rate limit, numbering, and a count of every message."""

import logging
import struct
from collections import Counter, deque
from collections.abc import Callable, Mapping
from typing import Final

from gateway.ros1 import image, point_cloud
from gateway.ros1.errors import MessageError, TypeMismatchError
from gateway.ros1.messages import ANY_TYPE, message_type
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import TopicType
from gateway.to_bus.shaping.frame_rates import StreamRate
from gateway.to_bus.shaping.stream_output import OutputCounts
from gateway.to_bus.translators import (
    Incomplete,
    Merging,
    NotOrganised,
    Repaired,
    StreamKind,
    Translate,
    camera_info,
    images,
)
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import Header, gap
from schemas.image import ImageFrame
from schemas.keys import SensorKey, owner_of
from schemas.points import PointCloud
from schemas.ros import RawMessage
from schemas.status import BEYOND_USE, REPLACED_BEFORE_LINK, THINNED, UNWANTED, StreamStatus

NUMBERED: Final = frozenset(
    (image.TYPE_NAME, images.COMPRESSED_TYPE, camera_info.TYPE_NAME, point_cloud.TYPE_NAME, images.DISPARITY_TYPE)
)
"""Types that begin with a std_msgs/Header, whose seq ROS's own publishers count up."""

MAX_PUBLISHERS: Final = 64
_SEQ: Final = struct.Struct("<I")


class Gaps:
    """Counts messages of a topic that did not arrive, by its publishers' sequence numbers.

    Nodes that pass on another's messages pass on their numbers too: messages that `throttle` drops count as missing.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._last: dict[str, int] = {}

    def begin(self) -> None:
        """Start over after a pause: messages sent in the pause are not missing."""
        self._last.clear()

    def arrived(self, message: Message) -> None:
        """Note a message. A number no higher than the last, or far higher, starts over, as when a bag loops.

        Latching publishers say nothing: rospy's give a number to each subscriber that comes late.
        """
        publisher = message.publisher
        if publisher.type.name not in NUMBERED or publisher.latching or len(message.data) < _SEQ.size:
            return
        (seq,) = _SEQ.unpack_from(message.data)
        last = self._last.get(message.uri)
        if last is None and len(self._last) >= MAX_PUBLISHERS:
            self._last.clear()
        self._last[message.uri] = seq
        if last is not None:
            self.missing += gap(last, seq)


SPAN_NS: Final = 5_000_000_000
READINGS: Final = 64


class Meter:
    """Measures the recent growth of a count from successive readings."""

    def __init__(self) -> None:
        self._readings: deque[tuple[int, int]] = deque(maxlen=READINGS)

    def hz(self, count: int, now_ns: int) -> float:
        """Add a reading; return the count's growth per second since the newest reading that is SPAN_NS old.

        While there is none, since the first one, which says 0; the clock going back starts over.
        """
        if self._readings and now_ns < self._readings[-1][0]:
            self._readings.clear()
        self._readings.append((now_ns, count))
        while len(self._readings) > 2 and now_ns - self._readings[1][0] >= SPAN_NS:
            self._readings.popleft()
        then_ns, before = self._readings[0]
        return max(0, count - before) * 1e9 / (now_ns - then_ns) if now_ns > then_ns else 0.0


log = logging.getLogger(__name__)

MALFORMED: Final = "malformed"
MISMATCH: Final = "of a type that the stream cannot carry"

_RATE_LIMITED: Final = (ImageFrame, PointCloud, RawMessage)


class StreamForward:
    """Translates a topic's messages to the fleet's schema.

    boot_id: this gateway process. Numbers count on while nobody listens and the topic is not subscribed.
    rate_limiter: leaves out frames beyond the stream's rate, before they are numbered. useful: tells, of a frame that
        is here at a time in nanoseconds since the epoch, whether anybody can use it.
    """

    def __init__(
        self,
        key: SensorKey,
        topic: str,
        kind: StreamKind,
        boot_id: str,
        rate_limiter: StreamRate | None = None,
        *,
        useful: Callable[[int], bool] = lambda _: True,
    ) -> None:
        self.key = key
        self.topic = topic
        self.kind = kind
        self.rate_limiter = rate_limiter
        self._useful = useful
        self._robot, self._camera = owner_of(key)
        self._boot_id = boot_id
        self._translates: dict[TopicType, Translate] = {}
        self._received = 0
        self._translated = 0
        self._left_out = 0
        self._repaired = 0
        self._no_picture: str | None = None
        self._dropped: Counter[str] = Counter()
        self._gaps = Gaps()
        self._received_rate, self._forwarded_rate = Meter(), Meter()
        self._replaced = 0
        self._broken_links: Counter[str] = Counter()
        self._shaped = OutputCounts()
        self.reset()

    def reset(self) -> None:
        """Start with a topic and a kind; the state of earlier messages is forgotten."""
        translators = self.kind.translators
        begun = {begin: begin() for begin in set(translators.values())}
        self._no_picture = None
        self._translates = {message_type(name).topic_type: begun[begin] for name, begin in translators.items()}

    @property
    def no_picture(self) -> str:
        """Why the topic's clouds are not images, as long as clouds but no image have come; else empty."""
        return self._no_picture or ""

    def begin(self) -> None:
        """Start a subscription: publishers of earlier ones no longer count."""
        self._gaps.begin()
        for translate in self._translates.values():
            if isinstance(translate, Merging):
                translate.begin()

    def take(self, message: Message, now_ns: int) -> codec.Message | None:
        """Return a ROS message's translation, or None if it is malformed or over the rate, which is counted.

        now_ns: when the whole message was here, nanoseconds since the epoch.
        """
        self._received += 1
        self._gaps.arrived(message)
        try:
            translated = self._translate(message, self._header(now_ns))
        except TypeMismatchError as error:
            self._leave_out(MISMATCH, message, error)
            return None
        except Incomplete as error:
            self._left_out += error.left_out
            log.warning("%s from %s: %s", self.topic, message.callerid, error)
            translated = error.rest
        except Repaired as error:
            self._note_repair(message, error)
            translated = error.made
        except (MessageError, SchemaError) as error:
            if isinstance(error, NotOrganised) and self._no_picture is None:
                self._no_picture = str(error)
            self._leave_out(MALFORMED, message, error)
            return None
        self._no_picture = ""
        if not message.publisher.latching and (reason := self._one_too_many(translated, now_ns)):
            self._dropped[reason] += 1
            return None
        self._translated += 1
        return translated

    def leave_out_unwanted(self, message: Message) -> None:
        """Count a message that came when the stream was no longer wanted."""
        self._received += 1
        self._gaps.arrived(message)
        self._dropped[UNWANTED] += 1

    def _one_too_many(self, message: codec.Message, now_ns: int) -> str:
        """Return the reason to leave a message out, or an empty string."""
        if self.rate_limiter is None or not isinstance(message, _RATE_LIMITED):
            return ""
        if not self.rate_limiter.passes(message.header.stamp_ns, now_ns):
            return THINNED
        return "" if self._useful(now_ns) else BEYOND_USE

    def _translate(self, message: Message, header: Header) -> codec.Message:
        kind = message.publisher.type
        translate = self._translates.get(kind) or self._translates.get(ANY_TYPE.topic_type)
        if translate is None:
            raise TypeMismatchError(f"{kind.name} [{kind.md5sum}] is not one of {', '.join(self.kind.translators)}")
        if len(message.data) > self.kind.max_bytes:
            raise MessageError(f"{kind.name} of {len(message.data)} bytes, at most {self.kind.max_bytes} are read")
        return translate(message, header)

    def _leave_out(self, reason: str, message: Message, error: Exception) -> None:
        self._dropped[reason] += 1
        log.warning("%s from %s: message left out: %s", self.topic, message.callerid, error)

    def _note_repair(self, message: Message, error: Repaired) -> None:
        """Count a repair, and log the driver's fault ever more rarely."""
        self._repaired += 1
        if self._repaired.bit_count() == 1:
            log.warning("%s from %s: %s (%d so far)", self.topic, message.callerid, error, self._repaired)

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

    def retire(self, *, replaced: int, broken_links: Mapping[str, int], output: OutputCounts) -> None:
        """Add the final counts (see `status`) of an ended subscription or output to the stream's."""
        self._replaced += replaced
        self._broken_links.update(broken_links)
        self._shaped += output

    def dropped(self) -> Counter[str]:
        """Return the drops of ended subscriptions and outputs, by reason."""
        return self._dropped + self._lost(0, self._shaped)

    def _lost(self, replaced: int, output: OutputCounts) -> Counter[str]:
        return Counter(output.dropped) + Counter({REPLACED_BEFORE_LINK: self._replaced + replaced})

    def status(
        self,
        *,
        wanted: bool,
        publishers: int,
        replaced: int,
        broken_links: Mapping[str, int],
        output: OutputCounts | None = None,
        now_ns: int = 0,
        problem: str = "",
    ) -> StreamStatus:
        """Return the stream's status, which accounts for every message.

        replaced: how many payloads a newer one replaced before the link. output: what became of them before that.
        These and `broken_links` are about what goes on now; counts given to `retire` are added. now_ns: as `take` has
        it.
        """
        shaped = self._shaped + (output or OutputCounts())
        lost = self._lost(replaced, shaped)
        forwarded = self._translated - lost.total()
        return StreamStatus(
            camera=self._camera,
            stream=self.key.stream,
            topic=self.topic,
            wanted=wanted,
            publishers=publishers,
            received=self._received,
            missing=self._gaps.missing,
            left_out=self._left_out,
            repaired=self._repaired,
            forwarded=forwarded,
            dropped=dict(self._dropped + lost),
            broken_links=dict(self._broken_links + Counter(broken_links)),
            problem=problem,
            received_hz=self._received_rate.hz(self._received, now_ns),
            forwarded_hz=self._forwarded_rate.hz(forwarded, now_ns),
            bytes=shaped.bytes,
            compression=shaped.compression,
        )
