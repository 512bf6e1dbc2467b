"""One direction of a link that is thin, slow, loses packets, or is gone. Pure: times are arguments."""

import random
from collections.abc import Callable
from typing import Final

import msgspec

QUEUE_S: Final = 0.2
"""The longest time that a packet waits for its turn on a thin link; what would wait longer is lost, as at a radio."""


class Conditions(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a link, both ways.

    mbit: megabits a second, None for as fast as it goes. loss: part of packets lost, 0 to 1, each by itself. delay_ms
    +- jitter_ms: of each packet, evenly distributed; packets keep their order, as on a radio link. blocked: a TCP or
    UDP port of either end whose packets are lost, 0 for none.
    """

    up: bool = True
    mbit: float | None = None
    loss: float = 0.0
    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    blocked: int = 0


class Shaper:
    """One direction of a link. even: returns a random number from 0 to 1. lost: packets so far."""

    def __init__(self, even: Callable[[], float] = random.random) -> None:
        self.conditions = Conditions()
        self.lost = 0
        self._even = even
        self._free_s = 0.0
        self._last_s = 0.0

    def leaves_s(self, packet: bytes, now_s: float) -> float | None:
        """Take a packet; return when it leaves at the other end, None if it is lost."""
        now = self.conditions
        lost = not now.up or (now.loss and self._even() < now.loss) or (now.blocked and now.blocked in ports(packet))
        sent_s = now_s
        if now.mbit is not None and not lost:
            waits_s = max(0.0, self._free_s - now_s)
            lost = waits_s > QUEUE_S
            if not lost:
                sent_s = self._free_s = now_s + waits_s + len(packet) * 8 / (now.mbit * 1e6)
        if lost:
            self.lost += 1
            return None
        delay_s = max(0.0, now.delay_ms + now.jitter_ms * (2 * self._even() - 1)) / 1e3
        self._last_s = max(self._last_s, sent_s + delay_s)
        return self._last_s


def ports(packet: bytes) -> tuple[int, int]:
    """Return the ports of an IPv4 packet's ends, source first; those of what has no ports mean nothing."""
    start = (packet[0] & 0x0F) * 4
    return int.from_bytes(packet[start : start + 2]), int.from_bytes(packet[start + 2 : start + 4])
