"""Whether the monitor hears the fleet: its link, and a heartbeat that it sends to itself."""

import asyncio
import time
from collections.abc import Callable
from typing import Final
from uuid import uuid4

from bus import LATEST, Bus, Publisher, QoS
from schemas import keys
from services.monitor.inventory.inventory import SETTLE_NS
from services.monitor.inventory.sighting import NS

PULSE_S: Final = 1.0
"""Seconds between two heartbeats."""

GAP_S: Final = 1.0
"""Maximum delay, in seconds, between the fleet's disappearance and the detection of a lost link."""


class Heartbeat:
    """Tracks whether the monitor hears the fleet. Seconds are of the steady clock.

    heard: when the monitor heard a message of its own last, None while it knows that it cannot hear the fleet.
    lease_s: after how long a link counts as lost: as much later than the monitor's own others may notice theirs.
    deaf: the fleet is not heard. settled: it is, and everybody who is there had time to appear.
    """

    def __init__(self, heard: Callable[[], float | None], lease_s: float) -> None:
        self._heard = heard
        self.lease_s = lease_s
        self._patience_s = lease_s + 2 * PULSE_S
        self._settle_s = SETTLE_NS / NS + lease_s
        self._settled_s = 0.0
        self.heard_s = 0.0
        self.deaf = False
        self.settled = True

    def advance(self, now_s: float) -> bool:
        """Advance time; return whether the monitor became deaf, hears again or has settled.

        It is deaf too while its own message is late: it was held up, and so may have been who heard nothing of it.
        """
        before = (self.deaf, self.settled)
        heard_s = self._heard()
        deaf = heard_s is None or now_s - heard_s > self._patience_s
        if self.deaf and not deaf:
            self._settled_s = now_s + self._settle_s
        self.heard_s = self.heard_s if heard_s is None else heard_s
        self.deaf = deaf
        self.settled = not deaf and now_s >= self._settled_s
        return (self.deaf, self.settled) != before


STALLED_S: Final = 10.0
"""Seconds without its own heartbeat after which the monitor counts as deaf."""


class Health:
    """Explains why the fleet cannot be heard. hub: others link to this monitor, so that it needs no link of its own."""

    def __init__(self, bus: Bus, *, hub: bool = False) -> None:
        self._bus = bus
        self._hub = hub
        self._heard_s = time.monotonic()

    @property
    def problem(self) -> str:
        """Why the fleet cannot be heard, in words, or empty."""
        return self._bus.link_problem or self._stalled()

    def heard_s(self) -> float | None:
        """Return when the last own heartbeat arrived (steady clock); None while the fleet cannot be heard."""
        return None if self._stalled() or (self._bus.link_problem and not self._hub) else self._heard_s

    def _stalled(self) -> str:
        silent_s = time.monotonic() - self._heard_s
        return f"nothing has arrived on the bus for {silent_s:.0f} s" if silent_s > STALLED_S else ""

    async def run(self) -> None:
        """Send and receive heartbeats until cancelled."""
        key = keys.monitor_pulse(uuid4().hex)
        async with (
            self._bus.subscribe(key, LATEST) as subscription,
            self._bus.publisher(key, QoS.STATUS) as publisher,
            asyncio.TaskGroup() as group,
        ):
            group.create_task(self._beat(publisher))
            async for _ in subscription:
                self._heard_s = time.monotonic()

    async def _beat(self, publisher: Publisher) -> None:
        while True:
            publisher.put(b"")
            await asyncio.sleep(PULSE_S)
