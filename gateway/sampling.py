"""Looks at one message of each image whose name does not say whether it is colour or depth."""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import replace
from typing import Any, Final

from gateway.discovery.topics import Topic, image_of
from gateway.ros1.errors import Ros1Error
from gateway.ros1.subscriber import Message
from gateway.ros1.wire.tcpros import ANY
from gateway.subscriptions import Subscriptions
from gateway.translators.encoding import TYPES, UNKNOWN, encoding_of

log = logging.getLogger(__name__)

PATIENCE_S: Final = 2.0
"""How long an image that nobody sends is waited for; then its name counts until a message comes."""

MAX_AT_ONCE: Final = 64
"""How many topics are listened to at once; the names of others count."""


_Image = tuple[str, str]
"""A topic's name and type: who else publishes it makes no other image of it."""


class Sampler:
    """Knows the encodings of images of which a message was heard.

    group: runs what listens. changed: called when something became known, or was waited for long enough.
    """

    def __init__(
        self,
        group: asyncio.TaskGroup,
        topics: Subscriptions,
        changed: Callable[[], Coroutine[Any, Any, None]],
        patience_s: float = PATIENCE_S,
    ) -> None:
        self._group = group
        self._topics = topics
        self._changed = changed
        self._patience_s = patience_s
        self._encodings: dict[_Image, str] = {}
        self._waited_for: set[_Image] = set()
        self._listening: dict[_Image, asyncio.Task[None]] = {}

    def known(self, topics: Iterable[Topic]) -> list[Topic]:
        """Return the topics with what is known of their pixels, and forget it of all others."""
        found = [(topic, self._encodings.get(_image(topic), "")) for topic in topics]
        self._encodings = {_image(topic): encoding for topic, encoding in found if encoding}
        return [replace(topic, encoding=encoding) if encoding else topic for topic, encoding in found]

    def listen(self, unclear: Iterable[Topic]) -> set[str]:
        """Listen to these topics and to no others until a message of each has come.

        Return the names of the images of which one may come at any moment.
        """
        wanted = {_image(topic) for topic in list(unclear)[:MAX_AT_ONCE]}
        for image in self._listening.keys() - wanted:
            self._listening.pop(image).cancel()
            self._waited_for.discard(image)
        for image in wanted - self._listening.keys():
            self._listening[image] = self._group.create_task(self._sample(image))
        return {image_of(name) for name, _ in wanted - self._waited_for}

    async def _sample(self, image: _Image) -> None:
        heard: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        name, _ = image
        try:
            async with self._topics.subscribe(
                name,
                ANY,
                lambda message: _take(heard, message),
                accepted=TYPES,
                on_gone=lambda _: None,
                on_unkept=lambda _: None,
            ):
                await asyncio.wait([heard], timeout=self._patience_s)
                if not heard.done():
                    self._waited_for.add(image)
                    self._group.create_task(self._changed())  # it may end this task, and is to be done nevertheless
                self._encodings[image] = await heard
        except Ros1Error as error:
            log.debug("%s: not looked at: %s", name, error)
            self._encodings[image] = UNKNOWN
        self._listening.pop(image, None)
        self._waited_for.discard(image)
        await self._changed()


def _image(topic: Topic) -> _Image:
    return topic.name, topic.type


def _take(heard: asyncio.Future[str], message: Message) -> None:
    if not heard.done():
        heard.set_result(encoding_of(message))
