"""The link of the monitor, and the heartbeat that it sends to itself over the bus."""

import asyncio
import time
from uuid import uuid4

from bus import LATEST, Bus, Publisher, QoS
from schemas import keys
from services.monitor.liveness import PULSE_S, STALLED_S


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
