"""A queue of one stream's messages that wait in order for the uplink's budget."""

from collections import deque
from collections.abc import Callable
from typing import Final

from bus import SMALL_BYTES, SMALL_WAITING, Payload
from gateway.to_bus.shaping.uplink_pacer import Pacer

WAITING_BYTES: Final = 128 << 10
"""Most bytes of waiting small messages: a second's worth on a link of 1 Mbit/s."""


class PacedQueue:
    """Holds the newest SMALL_WAITING messages of up to WAITING_BYTES; one over SMALL_BYTES replaces all."""

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
