"""Samples topics whose names do not tell their content, until a message does."""

import asyncio
import logging
from collections.abc import Callable, Collection, Coroutine, Iterable
from dataclasses import replace
from typing import Any, Final

from gateway.discovery.published_topics import Topic, image_of
from gateway.ros1.errors import Ros1Error
from gateway.ros1.tcpros.subscriber import Message
from gateway.ros1.wire.tcpros import ANY
from gateway.to_bus.subscriptions import Subscriptions
from gateway.to_bus.translators.pixel_encoding import CLOUDS, IMAGES, UNKNOWN, encoding_of

log = logging.getLogger(__name__)

SAMPLE_TIMEOUT_S: Final = 2.0
"""Longest wait for a silent topic; then others no longer wait for it."""

MAX_AT_ONCE: Final = 64
"""Most topics sampled at once; further ones stay unknown."""

_Sampled = tuple[str, str]
"""A topic's name and type; its publishers do not matter."""


class Sampler:
    """Finds the encodings of images, and of images in clouds, from their messages.

    group: runs what listens. changed: called when something became known, or was waited for long enough.
    """

    def __init__(
        self,
        group: asyncio.TaskGroup,
        topics: Subscriptions,
        changed: Callable[[], Coroutine[Any, Any, None]],
        patience_s: float = SAMPLE_TIMEOUT_S,
    ) -> None:
        self._group = group
        self._topics = topics
        self._changed = changed
        self._patience_s = patience_s
        self._encodings: dict[_Sampled, str] = {}
        self._doubted: set[_Sampled] = set()
        self._waited_for: set[_Sampled] = set()
        self._listening: dict[_Sampled, asyncio.Task[None]] = {}

    def known(self, topics: Iterable[Topic]) -> list[Topic]:
        """Return the topics with their known encodings, and forget all other topics."""
        found = [(topic, self._encodings.get(_sampled(topic), "")) for topic in topics]
        self._encodings = {_sampled(topic): encoding for topic, encoding in found if encoding}
        self._doubted &= self._encodings.keys()
        return [replace(topic, encoding=encoding) if encoding else topic for topic, encoding in found]

    def doubt(self, names: Collection[str]) -> None:
        """Topics with these names have other publishers: their known pixel formats count until a message comes."""
        self._doubted |= {sampled for sampled in self._encodings if sampled[0] in names}

    @property
    def doubted(self) -> set[str]:
        """The names of the topics whose encodings are in doubt."""
        return {name for name, _ in self._doubted}

    def certain(self, topics: Iterable[Topic]) -> list[Topic]:
        """Return the topics without the encodings that are in doubt."""
        return [replace(topic, encoding="") if _sampled(topic) in self._doubted else topic for topic in topics]

    def listen(self, unclear: Iterable[Topic]) -> set[str]:
        """Listen to these topics only, until each has sent a message.

        Return the names of the images of which nothing is known and a message may come at any moment.
        """
        wanted = {_sampled(topic) for topic in list(unclear)[:MAX_AT_ONCE]}
        for sampled in self._listening.keys() - wanted:
            self._listening.pop(sampled).cancel()
            self._waited_for.discard(sampled)
        for sampled in wanted - self._listening.keys():
            self._listening[sampled] = self._group.create_task(self._sample(sampled))
        return {image_of(name) for name, _ in wanted - self._waited_for - self._encodings.keys()}

    async def _sample(self, sampled: _Sampled) -> None:
        told: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        name, kind = sampled
        is_cloud = kind in CLOUDS
        try:
            async with self._topics.subscribe(
                name,
                kind if is_cloud else ANY,
                lambda message: _take(told, message),
                accepted=CLOUDS if is_cloud else IMAGES,
                on_gone=lambda _: None,
                on_unkept=lambda _: None,
            ):
                await asyncio.wait([told], timeout=self._patience_s)
                if not told.done():
                    self._waited_for.add(sampled)
                    self._group.create_task(self._changed())  # in a task of its own, since it may cancel this one
                self._learn(sampled, await told)  # at once: to unsubscribe may take longer than the topic stands
        except Ros1Error as error:
            log.debug("%s: not sampled: %s", name, error)
            self._learn(sampled, UNKNOWN)
        self._listening.pop(sampled, None)
        self._waited_for.discard(sampled)
        self._doubted.discard(sampled)
        await self._changed()

    def _learn(self, sampled: _Sampled, encoding: str) -> None:
        self._encodings[sampled] = encoding
        name, kind = sampled
        if kind in CLOUDS and encoding == UNKNOWN:
            log.info("%s: its points are not an image, so its camera gets no colour stream from them", name)


def _sampled(topic: Topic) -> _Sampled:
    return topic.name, topic.type


def _take(told: asyncio.Future[str], message: Message) -> None:
    if not told.done() and (encoding := encoding_of(message)):
        told.set_result(encoding)
