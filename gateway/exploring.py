"""Follows the ROS graph and offers streams for the topics published there."""

import asyncio
import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from typing import Final

from gateway.discovery import DiscoverySettings, plan, unclear, unclear_clouds
from gateway.discovery.plan import NO_PLAN, Plan, Source
from gateway.discovery.published_topics import Topic, TopicHistory, image_of, is_topic, topics_of
from gateway.offers import Offers
from gateway.ros1.errors import Ros1Error
from gateway.ros1.node import Node
from gateway.ros1.point_cloud import TYPE_NAME as POINT_CLOUD
from gateway.ros1.registrar import MasterState
from gateway.sampling import Sampler
from gateway.to_bus.translators.pixel_encoding import UNKNOWN
from schemas.keys import Stream, StreamKey

MAX_LISTED: Final = 12
MAX_SHOWN: Final = 80


def changes(now: Plan, before: Plan = NO_PLAN) -> list[str]:
    """Return a log line for each new, changed or gone stream, and for each reason to leave topics out."""
    return [*_streams(now, before), *_gone(now, before), *_left_out(now.left_out, before.left_out)]


def _streams(now: Plan, before: Plan) -> Iterator[str]:
    for key, source in now.streams.items():
        old = before.streams.get(key)
        if old is None:
            yield f"{key.name}: {_said(source)}"
        elif old.topic != source.topic:
            yield f"{key.name}: {_said(source)} now, no longer {old.topic}"
        elif old.type != source.type:
            yield f"{key.name}: {_said(source)} now"


def _gone(now: Plan, before: Plan) -> Iterator[str]:
    for key in sorted(before.streams.keys() - now.streams.keys(), key=str):
        yield f"{key.name}: no longer offered, {_fate(before.streams[key].topic, now)}"


def _fate(topic: str, now: Plan) -> str:
    """Return in words what has become of a stream's former topic."""
    user = next((key for key, source in now.streams.items() if source.topic == topic), None)
    if user is None:
        return f"{topic} is {'left out' if topic in now.left_out else 'gone'}"
    of_points = isinstance(user, StreamKey) and user.stream is Stream.POINTS
    return f"{topic} {'has points and no picture' if of_points else f'is {user.name}'}"


def _said(source: Source) -> str:
    return f"{source.topic} ({source.type[:MAX_SHOWN] or 'not known to the ROS master yet'})"


def _left_out(now: Mapping[str, str], before: Mapping[str, str]) -> Iterator[str]:
    by_reason: dict[str, list[str]] = {}
    for topic, reason in now.items():
        if before.get(topic) != reason:
            by_reason.setdefault(reason, []).append(topic)
    for reason, topics in sorted(by_reason.items()):
        more = f" and {len(topics) - MAX_LISTED} more" if len(topics) > MAX_LISTED else ""
        yield f"left out, {reason}: {', '.join(map(_shown, topics[:MAX_LISTED]))}{more}"


def _shown(topic: str) -> str:
    return topic if is_topic(topic) else repr(topic[:MAX_SHOWN])


log = logging.getLogger(__name__)

TYPES_EVERY: Final = 10
"""Looks at the master between requests of types without a change: a node may return with another type."""


class Explorer:
    """Keeps the plan current, and logs its streams, left-out topics and changes.

    Where only an image's pixels say whether it is colour or depth, one message of it is looked at first; and the clouds
    of a camera without another colour give it one once the first points that come are a picture. Both are looked at
    again when a topic has other publishers, or was gone at one look.
    unused: returns which settings are for none of the streams with these names.
    """

    def __init__(
        self,
        node: Node,
        discovery_settings: DiscoverySettings,
        unused: Callable[[Collection[str]], list[str]],
        sightings: TopicHistory | None = None,
    ) -> None:
        self.plan = plan([], discovery_settings)
        self._node = node
        self._discovery_settings = discovery_settings
        self._unused = unused
        self._said_unused: list[str] = []
        self._sightings = sightings or TopicHistory()
        self._publishers: Mapping[str, tuple[str, ...]] | None = None
        self._present: Mapping[str, frozenset[str]] = {}
        self._types: dict[str, str] = {}
        self._certain: list[Topic] = []
        self._unclear: list[Topic] = []
        self._planned: list[Topic] = []
        self._planning = asyncio.Lock()
        self._said = ""
        self._pid = 0

    @property
    def waiting_for(self) -> str:
        """The things missing before the gateway can offer anything, in words, or empty."""
        return "" if self.plan.streams else "a camera, a lidar or transforms on the ROS graph"

    @property
    def published(self) -> Collection[str]:
        """The topics that were published when the master was last looked at."""
        return self._present.keys()

    async def begin(self, offers: Offers) -> None:
        """Offer the streams that the settings name, with or without a master."""
        if not self._discovery_settings.discover:
            log.info("only the streams that the settings name are offered; --discover finds others as well")
        await self._follow(self.plan, offers, changes(self.plan))

    async def run(self, offers: Offers) -> None:
        """Keep `offers` in line with the plan, forever."""
        async with asyncio.TaskGroup() as group:

            async def replan() -> None:
                await self._replan(images, clouds, offers)

            images, clouds = (Sampler(group, offers.topics, replan) for _ in range(2))
            async for look in self._node.looks():
                started = self._started(look)
                for sampler in (images, clouds):
                    sampler.doubt(started)
                try:
                    await self._see(look)
                except Ros1Error as error:
                    log.warning(
                        "%s: what is published has changed, but not its types: %s", self._node.master_uri, error
                    )
                    continue
                await replan()

    async def _replan(self, images: Sampler, clouds: Sampler, offers: Offers) -> None:
        async with self._planning:
            known = clouds.known(images.known(self._sightings.topics()))
            certain = clouds.certain(images.certain(known))
            if certain != self._certain:
                self._unclear = await asyncio.to_thread(unclear, certain, self._discovery_settings)
                self._certain = certain
            awaited = images.listen(self._unclear)
            topics = [_until_heard(topic) for topic in known if image_of(topic.name) not in awaited]
            if topics != self._planned:
                # With thousands of topics it takes a second.
                now = await asyncio.to_thread(plan, topics, self._discovery_settings, self.plan)
                await self._follow(now, offers, changes(now, self.plan))
                self._planned = topics
            if not awaited:  # an image may be the colour
                clouds.listen(unclear_clouds(certain, self._discovery_settings, self.plan, clouds.doubted))

    def _started(self, look: MasterState) -> set[str]:
        """Return the topics that were not published at the look before, or by other nodes."""
        before, self._present = self._present, {name: frozenset(of) for name, of in look.state.publishers.items()}
        return {name for name, of in self._present.items() if before.get(name) != of}

    async def _see(self, look: MasterState) -> None:
        publishers = _without(look.node, look.state.publishers)
        if (
            publishers != self._publishers
            or look.number % TYPES_EVERY == 0
            or not publishers.keys() <= self._types.keys()
        ):
            types = await self._node.master.get_topic_types()
            self._pid = await self._node.master.get_pid()
            # Topics that a new master does not know yet keep their type.
            self._types = {name: types.get(name, self._types.get(name, "")) for name in publishers}
            self._publishers = publishers
        topics = topics_of(publishers, self._types)
        self._sightings.see(topics, asyncio.get_running_loop().time(), (self._pid, look.restarts))

    async def _follow(self, now: Plan, offers: Offers, lines: list[str]) -> None:
        self.plan = now
        for line in lines:
            log.info("%s", line)
        if self.waiting_for != self._said:
            self._said = self.waiting_for
            if self._said:
                log.info("waiting for %s", self._said)
        unused = self._unused([key.name for key in now.streams]) if now.streams else []
        if unused != self._said_unused:
            self._said_unused = unused
            if unused:
                unmasked = any(each.startswith("--privacy-mask") for each in unused)
                log.log(logging.WARNING if unmasked else logging.INFO, "no such stream: %s", ", ".join(unused))
        await offers.change(now)


def _until_heard(topic: Topic) -> Topic:
    """Return clouds without any points yet as not organised: late colour is better than colour that vanishes."""
    return replace(topic, encoding=UNKNOWN) if topic.type == POINT_CLOUD and not topic.encoding else topic


def _without(node: str, publishers: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Return the topics without those that only this node publishes."""
    others = {topic: tuple(name for name in names if name != node) for topic, names in publishers.items()}
    return {topic: names for topic, names in others.items() if names}
