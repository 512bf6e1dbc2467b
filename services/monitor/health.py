"""Whether the monitor can hear the fleet: its link, and a message of its own that has to come back."""

import asyncio
import time
from typing import Final
from uuid import uuid4

from bus import LATEST, Bus, Publisher, QoS
from schemas import keys
from services.monitor.hearing import PULSE_S

STALLED_S: Final = 10.0
"""After how long without its own message the monitor counts as deaf."""


class Health:
    """Knows why the mesh is dead. hub: others link to it, so that it may hear them without a link of its own."""

    def __init__(self, bus: Bus, *, hub: bool = False) -> None:
        self._bus = bus
        self._hub = hub
        self._heard_s = time.monotonic()

    @property
    def problem(self) -> str:
        """Why the fleet cannot be heard, in words, or empty."""
        return self._bus.link_problem or self._stalled()

    def heard_s(self) -> float | None:
        """Return when a message of its own came last, on the steady clock; None while the fleet cannot be heard."""
        return None if self._stalled() or (self._bus.link_problem and not self._hub) else self._heard_s

    def _stalled(self) -> str:
        silent_s = time.monotonic() - self._heard_s
        return f"the bus has brought nothing for {silent_s:.0f} s" if silent_s > STALLED_S else ""

    async def run(self) -> None:
        """Send and listen, for ever."""
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
