"""Tracks published topics across restarts of nodes and masters. Pure."""

import math
import re
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from gateway.node_names import is_gateway

MAX_TOPIC: Final = 256
TOPIC: Final = re.compile(r"/[A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*")
TRANSPORTS: Final = ("compressed", "compressedDepth")


@dataclass(frozen=True, slots=True, order=True)
class Topic:
    """A published topic.

    type, and encoding of an image's pixels or of the picture in a cloud: empty while it is not known.
    """

    name: str
    type: str
    publishers: tuple[str, ...]
    encoding: str = ""

    @property
    def only_gateways(self) -> bool:
        """Whether only gateways publish it."""
        return all(is_gateway(node) for node in self.publishers)


def is_topic(name: str) -> bool:
    """Return whether this is a global topic name that the contract can carry."""
    return len(name) <= MAX_TOPIC and TOPIC.fullmatch(name) is not None


def image_of(name: str) -> str:
    """Return the raw topic of a compressed image topic; any other name unchanged."""
    image, _, transport = name.rpartition("/")
    return image if image and transport in TRANSPORTS else name


def calibrations_of(name: str) -> tuple[str, str]:
    """Return the conventional camera_info topics of an image: beside it, or beside the left image of a pair."""
    space = image_of(name).rpartition("/")[0]
    return f"{space}/camera_info", f"{space}/left/camera_info"


def topics_of(publishers: Mapping[str, tuple[str, ...]], types: Mapping[str, str]) -> list[Topic]:
    """Return the published topics, given publishing nodes and message types by topic."""
    known = {name: kind for name, kind in types.items() if kind != "*"}
    return [Topic(name, known.get(name, ""), tuple(sorted(nodes))) for name, nodes in sorted(publishers.items())]


HOLD_S: Final = 30.0
MAX_GAP_S: Final = 5.0


@dataclass(slots=True)
class _Seen:
    topic: Topic
    at_s: float


class TopicHistory:
    """Remembers the published topics.

    A topic that is gone counts as published for `hold_s` more seconds, in which its node may restart. Only time in
    which the master answers counts. When a master has restarted, nodes may go on without registering again: topics
    published before then count as published until the new master has seen them once.
    """

    def __init__(self, hold_s: float = HOLD_S) -> None:
        self._hold_s = hold_s
        self._seen: dict[str, _Seen] = {}
        self._clock_s = 0.0
        self._last_s = math.inf
        self._life: Hashable = None

    def see(self, topics: Iterable[Topic], now_s: float, life: Hashable = None) -> None:
        """Update from the master's list; `life` changes when the master has restarted."""
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
        """Return the topics that count as published."""
        return [seen.topic for _, seen in sorted(self._seen.items())]
