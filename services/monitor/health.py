"""The link of the monitor, the heartbeat that it sends to itself over the bus, and whether it takes new links."""

import asyncio
import time
from typing import Final
from uuid import uuid4

from bus import LATEST, Bus, BusSettings, Publisher, QoS
from bus.session.probe import own_listeners, why_not_taken
from schemas import keys
from services.monitor.liveness import HEARTBEAT_S, STALLED_S

PROBE_S: Final = 10.0
"""Interval between tests of the own listeners."""

FAILURES: Final = 3
"""Failed tests in a row after which a listener counts as dead: one may fail while a whole fleet comes back."""


class Health:
    """Explains why the fleet cannot be heard, or cannot connect.

    hub: others link to this monitor, so that it needs no link of its own. settings: whose listeners are tested; a
    router may stop accepting while its links, and so the heartbeat, go on.
    """

    def __init__(
        self, bus: Bus, *, hub: bool = False, settings: BusSettings | None = None, probe_s: float = PROBE_S
    ) -> None:
        self._bus = bus
        self._settings = settings
        self._probe_s = probe_s
        self._refused = ""
        self._hub = hub
        self._heard_s = time.monotonic()

    @property
    def problem(self) -> str:
        """Why the fleet cannot be heard or cannot connect, in words, or empty."""
        return self._bus.link_problem or self._stalled() or self._refused

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
            if self._settings is not None:
                group.create_task(self._probe(self._settings))
            async for _ in subscription:
                self._heard_s = time.monotonic()

    async def _beat(self, publisher: Publisher) -> None:
        while True:
            publisher.put(b"")
            await asyncio.sleep(HEARTBEAT_S)

    async def _probe(self, settings: BusSettings) -> None:
        """Open a session over each own listener now and then. No link is to spare for that where all are in use."""
        failures = dict.fromkeys(own_listeners(settings), 0)
        while failures:
            await asyncio.sleep(self._probe_s)
            said = []
            for endpoint in failures:
                full = self._bus.links.count >= self._bus.links.limit
                why = "" if full else await asyncio.to_thread(why_not_taken, settings, endpoint)
                failures[endpoint] = failures[endpoint] + 1 if why else 0
                if failures[endpoint] >= FAILURES:
                    said.append(f"{endpoint} takes no new links: {why}")
            self._refused = "; ".join(said)
