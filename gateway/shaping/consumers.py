"""Who subscribes to a robot's streams, and whether all of them are on this machine."""

import ipaddress
import logging
import re
from typing import Final

from bus import Bus, BusSettings, Presence
from schemas import keys
from schemas.errors import SchemaError
from schemas.keys import StreamKey, Wanted

MAX_CONSUMERS: Final = 10_000

log = logging.getLogger(__name__)


class Consumers:
    """What consumers say of themselves, by their tokens.

    clock_id: this machine's. near: whether what this process sends to one on the same machine stays on it.
    """

    def __init__(self, robot: str, clock_id: str, *, near: bool) -> None:
        self._robot = robot
        self._clock_id = clock_id
        self._near = near
        self._known: dict[StreamKey, set[Wanted]] = {}
        self._count = 0

    def all_here(self, key: StreamKey) -> bool:
        """Return whether everybody who says to subscribe to the stream is on this machine, and somebody does."""
        known = self._known.get(key)
        return self._near and bool(known) and all(each.clock_id == self._clock_id for each in known or ())

    def note(self, presence: Presence) -> None:
        """Take in that a token appeared or vanished."""
        try:
            wanted = keys.parse_wanted(presence.key)
        except SchemaError as error:
            log.warning("%s: consumer left out: %s", presence.key[:200], error)
            return
        known = self._known.setdefault(wanted.key, set())
        before = len(known)
        if not presence.alive:
            known.discard(wanted)
        elif self._count < MAX_CONSUMERS:
            known.add(wanted)
        self._count += len(known) - before
        if not known:
            del self._known[wanted.key]

    async def follow(self, bus: Bus) -> None:
        """Take in who comes and goes, for ever."""
        async with bus.watch(keys.every_wanted(self._robot)) as watch:
            async for presence in watch:
                self.note(presence)


def stays_near(settings: BusSettings) -> bool:
    """Return whether two processes on this machine reach each other without its network: not by way of a far router."""
    return settings.mode != "client" or (bool(settings.connect) and all(map(_is_loopback, settings.connect)))


def _is_loopback(endpoint: str) -> bool:
    host = re.sub(r":\d+(?:[?#].*)?$", "", endpoint.partition("/")[2]).strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
