"""Follow the ROS graph: what is published there decides what is offered."""

import asyncio
import logging
from collections.abc import Callable, Collection, Mapping
from typing import Final

from gateway.discovery import Plan, Wishes, plan
from gateway.discovery.report import changes
from gateway.discovery.sightings import Sightings
from gateway.discovery.topics import Topic, topics_of
from gateway.offers import Offers
from gateway.ros1.errors import Ros1Error
from gateway.ros1.node import Node
from gateway.ros1.point_cloud import TYPE_NAME as POINT_CLOUD
from gateway.ros1.registrar import Look
from gateway.ros1.subscriber import Message
from gateway.subscriptions import Subscriptions
from gateway.translators import shows_picture

log = logging.getLogger(__name__)

TYPES_EVERY: Final = 10
"""Looks after which types are asked for although nothing else has changed: a node may come back with another type."""


class Clouds:
    """Finds out which topics of points are pictures: their names do not tell, but the first points that come do."""

    def __init__(self) -> None:
        self._known: dict[str, bool] = {}
        self._listening: dict[str, asyncio.Task[None]] = {}

    def without_picture(self, topics: Collection[Topic]) -> set[str]:
        """Return those of the topics that are no pictures or not known to be; what is not among them is forgotten."""
        names = {topic.name for topic in topics if topic.type == POINT_CLOUD}
        self._known = {name: found for name, found in self._known.items() if name in names}
        for name in self._listening.keys() - names:
            self._listening.pop(name).cancel()
        return names - {name for name, found in self._known.items() if found}

    def find_out(self, names: Collection[str], topics: Subscriptions, group: asyncio.TaskGroup) -> None:
        """Listen to what is not known yet."""
        for name in set(names) - self._known.keys() - self._listening.keys():
            self._listening[name] = group.create_task(self._listen(name, topics))

    async def _listen(self, name: str, topics: Subscriptions) -> None:
        found: asyncio.Future[bool] = asyncio.get_running_loop().create_future()

        def look_at(message: Message) -> None:
            is_picture = shows_picture(message)
            if is_picture is not None and not found.done():
                found.set_result(is_picture)

        def nothing(_: object) -> None:
            """Take note of no publisher that goes, and of no message that is too large to be kept."""

        async with topics.subscribe(
            name, POINT_CLOUD, look_at, accepted=(POINT_CLOUD,), on_gone=nothing, on_unkept=nothing
        ):
            self._known[name] = await found
        del self._listening[name]
        if not self._known[name]:
            log.info("%s: its points are no picture, so they give their camera no colour", name)


class Explorer:
    """Keeps the plan current, and says in the log what it takes, what not, and every change.

    unused: returns which settings are for none of the streams with these names.
    """

    def __init__(
        self,
        node: Node,
        wishes: Wishes,
        unused: Callable[[Collection[str]], list[str]],
        sightings: Sightings | None = None,
    ) -> None:
        self.plan = plan([], wishes)
        self._node = node
        self._wishes = wishes
        self._unused = unused
        self._said_unused: list[str] = []
        self._sightings = sightings or Sightings()
        self._publishers: Mapping[str, tuple[str, ...]] | None = None
        self._types: dict[str, str] = {}
        self._clouds = Clouds()
        self._planned: tuple[list[Topic], set[str]] = [], set()
        self._said = ""
        self._pid = 0

    @property
    def waiting_for(self) -> str:
        """What there must be before anything can be offered, in words, or nothing."""
        return "" if self.plan.streams else "a camera, a lidar or transforms on the ROS graph"

    async def begin(self, offers: Offers) -> None:
        """Offer what the settings name, whether there is a master or not."""
        await self._follow(self.plan, offers, changes(self.plan))

    async def run(self, offers: Offers) -> None:
        """Let `offers` follow the plan, for ever."""
        async with asyncio.TaskGroup() as group:
            async for look in self._node.looks():
                try:
                    await self._see(look)
                except Ros1Error as error:
                    log.warning(
                        "%s: what is published has changed, but not its types: %s", self._node.master_uri, error
                    )
                    continue
                await self._plan(offers)
                if self._wishes.discover:
                    self._clouds.find_out(self.plan.without_colors(), offers.topics, group)

    async def _plan(self, offers: Offers) -> None:
        topics = self._sightings.topics()
        planned = topics, self._clouds.without_picture(topics)
        if planned != self._planned:
            # Of thousands of topics it takes a second.
            now = await asyncio.to_thread(plan, topics, self._wishes, self.plan, planned[1])
            await self._follow(now, offers, changes(now, self.plan))
            self._planned = planned

    async def _see(self, look: Look) -> None:
        publishers = _without(self._node.name, look.state.publishers)
        if (
            publishers != self._publishers
            or look.number % TYPES_EVERY == 0
            or not publishers.keys() <= self._types.keys()
        ):
            types = await self._node.master.get_topic_types()
            self._pid = await self._node.master.get_pid()
            # What a new master does not know yet stays what it was.
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
                log.info("for no stream that there is: %s", ", ".join(unused))
        await offers.change(now)


def _without(node: str, publishers: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Leave out what only the node itself publishes, whatever its settings call it."""
    others = {topic: tuple(name for name in names if name != node) for topic, names in publishers.items()}
    return {topic: names for topic, names in others.items() if names}
