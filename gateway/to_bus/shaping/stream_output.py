"""The last step of a stream in the gateway: shapes its messages and passes them to their publisher."""

import logging
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Final, Self

from bus import MAX_PAYLOAD_BYTES, SMALL_BYTES, SMALL_WAITING, Payload, Pieces, Publisher
from gateway.to_bus.shaping.compression import AUTO, LOSSY, NONE, Frame, Method
from gateway.to_bus.shaping.encoder_pool import EncodeJob, EncoderPool, Shaped
from gateway.to_bus.shaping.scaling import ShapingError, scale_info
from gateway.to_bus.shaping.uplink import Moment
from gateway.to_bus.shaping.uplink_pacer import Pacer
from schemas import codec
from schemas.camera_info import CameraInfo
from schemas.compression import RAW
from schemas.header import Header
from schemas.image import Area, ImageFrame
from schemas.keys import SensorKey, Stream
from schemas.status import ENDED, OVER_BUDGET, REPLACED_BEFORE_SHAPING, TOO_LARGE, UNSHAPED


@dataclass(frozen=True, slots=True)
class OutputCounts:
    """Drops by reason, payload bytes sent, and the last frame's compression; empty for other messages."""

    dropped: Mapping[str, int] = field(default_factory=dict)
    bytes: int = 0
    compression: str = ""

    def __add__(self, other: Self) -> "OutputCounts":
        """Return the sum of the counts of both."""
        return OutputCounts(
            Counter(self.dropped) + Counter(other.dropped),
            self.bytes + other.bytes,
            other.compression or self.compression,
        )


log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class OutputPlan:
    """The shaping of a stream.

    all_here: whether nobody elsewhere listens. droppable: whether its messages wait for the uplink's budget. moment_of:
        what a frame with such a header shares with those of other streams, or None. private: areas of its images that
        nobody is to see.
    """

    factor: int = 1
    method: Method = NONE
    private: tuple[Area, ...] = ()
    all_here: Callable[[], bool] = lambda: True
    droppable: bool = False
    moment_of: Callable[[Header], Moment | None] = lambda _: None

    def method_now(self) -> Method:
        """Return the method for the next frame."""
        if self.method.format != AUTO:
            return self.method
        return NONE if self.all_here() else LOSSY


WAITING_BYTES: Final = 128 << 10
"""Most bytes of waiting small messages: a second's worth on a link of 1 Mbit/s."""


class PacedQueue:
    """One stream's messages that wait in order for the uplink's budget.

    It holds the newest SMALL_WAITING messages of up to WAITING_BYTES; one over SMALL_BYTES replaces all.
    """

    def __init__(self, pacer: Pacer, send: Callable[[Payload], None]) -> None:
        self._pacer = pacer
        self._send = send
        self._waiting: deque[Payload] = deque()

    def put(self, payload: Payload) -> int:
        """Send a message as soon as the budget allows; return the number of older ones dropped for it."""
        lost = 0
        while self._waiting and not self._has_room(len(payload)):
            self._waiting.popleft()
            lost += 1
        self._waiting.append(payload)
        if lost or len(self._waiting) == 1:
            self._offer_first()
        return lost

    def flush(self) -> None:
        """Send waiting messages at once: no receiver is behind the link."""
        self._pacer.discard(self)
        while self._waiting:
            self._send(self._waiting.popleft())

    def close(self) -> int:
        """Stop sending; return the number of messages that waited."""
        self._pacer.discard(self)
        left = len(self._waiting)
        self._waiting.clear()
        return left

    def _has_room(self, size: int) -> bool:
        small = [len(each) for each in self._waiting if len(each) <= SMALL_BYTES]
        return size <= SMALL_BYTES and len(self._waiting) < SMALL_WAITING and sum(small) + size <= WAITING_BYTES

    def _offer_first(self) -> None:
        """Offer the oldest message to the pacer, replacing one that was dropped."""
        self._pacer.offer(self, self._waiting[0], self._send_first)

    def _send_first(self, payload: Payload) -> None:
        self._waiting.popleft()
        self._send(payload)
        if self._waiting:
            self._offer_first()


class StreamOutput:
    """Takes a stream's messages. Raw frames and messages other than frames are passed on directly."""

    def __init__(
        self,
        key: SensorKey,
        publisher: Publisher,
        plan: OutputPlan,
        encoder_pool: EncoderPool | None = None,
        pacer: Pacer | None = None,
    ) -> None:
        self._key = key
        self._publisher = publisher
        self._plan = plan
        self._encoder_pool = encoder_pool
        self._pacer = pacer
        self._queue = None if pacer is None else PacedQueue(pacer, self._send)
        self._dropped: Counter[str] = Counter()
        self._bytes = 0
        self._compression = ""

    @property
    def counts(self) -> OutputCounts:
        """Counts of the messages so far."""
        return OutputCounts(+self._dropped, self._bytes, self._compression)

    def put(self, message: codec.Message, *, may_be_last: bool = False) -> None:
        """Send a message, now or once it is shaped and the uplink's budget allows.

        may_be_last: it is left out for none but a newer one, not for other streams' later instants.
        """
        if isinstance(message, Frame):
            self._put_frame(message, may_be_last=may_be_last)
            return
        if isinstance(message, CameraInfo) and self._plan.factor > 1:
            message = scale_info(message, self._plan.factor, depth=self._key.stream == Stream.DEPTH_INFO)
        self._pass_on_in_order(codec.encode(message))

    def _put_frame(self, frame: Frame, *, may_be_last: bool) -> None:
        factor = self._plan.factor if isinstance(frame, ImageFrame) else 1
        method = self._plan.method_now()
        moment = None if self._pacer is None or may_be_last else self._plan.moment_of(frame.header)
        private = self._plan.private
        as_it_is = method.format == RAW and factor == 1 and not private
        if self._encoder_pool is None and private:
            self.on_error(ShapingError("nothing here can blacken it"))
            return
        if self._encoder_pool is None or (as_it_is and not self._encoder_pool.is_busy_for(self)):
            self._compression = frame.format
            self._pass_on(Pieces(*codec.encode_in_pieces(frame)), moment)
            return
        self._dropped[REPLACED_BEFORE_SHAPING] += self._encoder_pool.submit(
            self, EncodeJob(frame, factor, method, moment, private)
        )

    def shaped(self, made: Shaped) -> None:
        """See `EncoderClient`."""
        self._compression = str(made.method)
        self._pass_on(made.payload, made.moment)

    def on_error(self, error: Exception) -> None:
        """See `EncoderClient`."""
        self._dropped[UNSHAPED] += 1
        log.warning("%s: frame left out: %s", self._key, error)

    def _pass_on_in_order(self, payload: Payload) -> None:
        """Send a message other than a frame; if the budget applies to it, it waits behind earlier ones."""
        if not self._fits(payload):
            return
        if self._pacer is None or self._queue is None:
            self._send(payload)
        elif self._plan.all_here():
            self._queue.flush()
            self._send(payload)
        elif not self._plan.droppable:
            self._pacer.charge(len(payload))
            self._send(payload)
        else:
            self._dropped[OVER_BUDGET] += self._queue.put(payload)

    def _pass_on(self, payload: Payload, moment: Moment | None = None) -> None:
        if not self._fits(payload):
            return
        if self._pacer is None:
            self._send(payload)
        elif self._plan.all_here():
            self._dropped[OVER_BUDGET] += self._pacer.discard(self)
            self._send(payload)
        else:
            self._dropped[OVER_BUDGET] += self._pacer.offer(self, payload, self._send, moment=moment, lose=self._lose)

    def _fits(self, payload: Payload) -> bool:
        """Return whether receivers read a payload of this size; count it as dropped if not."""
        if len(payload) <= MAX_PAYLOAD_BYTES:
            return True
        self._dropped[TOO_LARGE] += 1
        log.warning(
            "%s: message of %d bytes left out: at most %d are carried; --scale makes images smaller",
            self._key,
            len(payload),
            MAX_PAYLOAD_BYTES,
        )
        return False

    def _lose(self) -> None:
        self._dropped[OVER_BUDGET] += 1

    def _send(self, payload: Payload) -> None:
        self._bytes += len(payload)
        self._publisher.put(payload)

    def close(self) -> None:
        """Stop sending, and count waiting messages as dropped."""
        if self._encoder_pool is not None:
            self._dropped[ENDED] += self._encoder_pool.leave(self)
        if self._pacer is not None:
            self._dropped[ENDED] += self._pacer.discard(self)
        if self._queue is not None:
            self._dropped[ENDED] += self._queue.close()


OutputOf = Callable[[SensorKey, Publisher], AbstractContextManager[StreamOutput]]
"""Opens the output of a stream to one of its publishers."""


@contextmanager
def unshaped(key: SensorKey, publisher: Publisher) -> Iterator[StreamOutput]:
    """Open an output that sends a stream's messages unshaped."""
    yield StreamOutput(key, publisher, OutputPlan())
