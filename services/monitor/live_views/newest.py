"""The newest pictures, class lists and clouds of cameras, and all live views of one monitor."""

import asyncio
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from bus import LATEST, QUEUE, Bus, Latest, Queue, Sample
from schemas import codec
from schemas.codec import Message
from schemas.detections import ClassList
from schemas.errors import SchemaError
from schemas.header import Header
from schemas.image import ImageFrame
from schemas.keys import Stream, StreamKey
from schemas.objects import ObjectClouds
from services.monitor.live_views.robot_poses import robots
from services.monitor.live_views.shared import SharedSubscriptions
from services.monitor.map.last_seen import LastPoses

MOST_STREAMS: Final = 64
"""Maximum number of different streams watched through one monitor at the same time."""

MOST_LISTS: Final = 64
"""Class lists kept per camera: a picture arrives some frames after its own list."""

MOST_LISTS_BYTES: Final = 8 << 20
"""Of those that are not taken yet."""

M = TypeVar("M", bound=Message)


class Newest(Generic[M]):
    """The newest message. number: messages so far. received_ns: arrival time. problem: the last one's error."""

    def __init__(self) -> None:
        self.message: M | None = None
        self.number = 0
        self.received_ns = 0
        self.problem = ""
        self._news = asyncio.Event()

    def take(self, message: M, received_ns: int) -> None:
        """Take a newer message, and wake those who wait."""
        self.message, self.received_ns, self.problem = message, received_ns, ""
        self.number += 1
        news, self._news = self._news, asyncio.Event()
        news.set()

    async def after(self, number: int) -> M:
        """Wait until more than `number` messages came; return the newest. Slow readers miss those in between."""
        while self.message is None or self.number <= number:
            await self._news.wait()
        return self.message


class FrameLists(Newest[ClassList]):
    """The newest class lists of a camera, by frame."""

    def __init__(self) -> None:
        super().__init__()
        self._of: dict[tuple[str, int], ClassList] = {}

    def take(self, message: ClassList, received_ns: int) -> None:
        """Take a newer list; the oldest over MOST_LISTS is dropped."""
        super().take(message, received_ns)
        self._of[message.header.boot_id, message.header.seq] = message
        if len(self._of) > MOST_LISTS:
            del self._of[next(iter(self._of))]

    def of(self, frame: Header) -> ClassList | None:
        """Return a model's counts in a frame; None if unknown."""
        return self._of.get((frame.boot_id, frame.seq))


Pictures = SharedSubscriptions[StreamKey, Newest[ImageFrame]]
Clouds = SharedSubscriptions[StreamKey, Newest[ObjectClouds]]
Lists = SharedSubscriptions[StreamKey, FrameLists]

OVERLAYS: Final = (Stream.OVERLAY_DETECTION, Stream.OVERLAY_SEGMENTATION)


def pictures(bus: Bus) -> Pictures:
    """Return the watched overlays; each is subscribed to, and so drawn, while somebody watches it."""
    return SharedSubscriptions(_nothing, lambda key, newest: follow(bus, key, ImageFrame, newest), MOST_STREAMS)


def clouds(bus: Bus) -> Clouds:
    """Return the watched object clouds; each is subscribed to, and so computed, while somebody watches it."""
    return SharedSubscriptions(_nothing, lambda key, newest: follow(bus, key, ObjectClouds, newest), MOST_STREAMS)


def lists(bus: Bus) -> Lists:
    """Return the counts in each of the newest frames of the watched cameras."""
    return SharedSubscriptions(
        lambda _: FrameLists(),
        lambda key, newest: follow(bus, key, ClassList, newest, QUEUE(MOST_LISTS, MOST_LISTS_BYTES)),
        MOST_STREAMS,
    )


def _nothing(_: StreamKey) -> Newest[M]:
    return Newest()


async def follow(bus: Bus, key: StreamKey, schema: type[M], newest: Newest[M], keep: Latest | Queue = LATEST) -> None:
    """Subscribe to the stream until cancelled; unusable messages are left out and reported."""
    async with bus.subscribe(str(key), keep, history=False) as subscription:
        async for sample in subscription:
            try:
                newest.take(_read(sample, key, schema), sample.received_ns)
            except SchemaError as error:
                newest.problem = str(error)


def _read(sample: Sample, key: StreamKey, schema: type[M]) -> M:
    message = codec.decode(schema, sample.payload, sample.encoding)
    assert isinstance(message, ImageFrame | ObjectClouds | ClassList)  # noqa: S101 - those that are asked for
    codec.check_identity(message.header, key.camera)
    return message


class LiveViews:
    """pictures: overlays. lists: class lists by frame. clouds: of objects. robots: their poses.

    Each is subscribed to while somebody looks.
    last_poses: where robots were when somebody looked. is_forgotten: see `LastPoses`.
    """

    def __init__(self, bus: Bus, is_forgotten: Callable[[str], bool]) -> None:
        self.pictures = pictures(bus)
        self.lists = lists(bus)
        self.clouds = clouds(bus)
        self.robots = robots(bus)
        self.last_poses = LastPoses(is_forgotten)
