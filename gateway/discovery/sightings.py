"""Which topics there are, although nodes restart and masters forget. Pure."""

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import Final

from gateway.discovery.topics import Topic

HOLD_S: Final = 30.0
MAX_GAP_S: Final = 5.0


@dataclass(slots=True)
class _Seen:
    topic: Topic
    at_s: float


class Sightings:
    """Remembers what was published.

    A topic that is gone counts as published for `hold_s` more seconds, in which its node may restart. Only time in
    which the master answers counts. When a master has restarted, nodes may go on without registering again: what was
    published before then counts as published until the new master has seen it once.
    """

    def __init__(self, hold_s: float = HOLD_S) -> None:
        self._hold_s = hold_s
        self._seen: dict[str, _Seen] = {}
        self._clock_s = 0.0
        self._last_s = math.inf
        self._life: Hashable = None

    def see(self, topics: Iterable[Topic], now_s: float, life: Hashable = None) -> None:
        """Take what the master says is published; `life` is another one once it has restarted."""
        self._clock_s += min(max(0.0, now_s - self._last_s), MAX_GAP_S)
        self._last_s = now_s
        if life != self._life:
            self._life = life
            for seen in self._seen.values():
                seen.at_s = math.inf
        for topic in topics:
            known = self._seen.get(topic.name)
            if known is None or not topic.only_gateways or known.topic.only_gateways:
                self._seen[topic.name] = _Seen(topic, self._clock_s)
        self._seen = {name: seen for name, seen in self._seen.items() if self._clock_s - seen.at_s < self._hold_s}

    def topics(self) -> list[Topic]:
        """Return what counts as published."""
        return [seen.topic for _, seen in sorted(self._seen.items())]
