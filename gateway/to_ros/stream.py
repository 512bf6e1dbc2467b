"""Passes one Zenoh key to ROS: checks messages and counts each one."""

import logging
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

from bus import LATEST, QUEUE
from bus.api import Latest, Queue
from schemas import codec
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL, FrameOrder, Header
from schemas.keys import CameraKey, RobotStreamKey, StreamKey, owner_of
from schemas.status import ReturnStatus

MAX_REMEMBERED: Final = 1_024

WAITING_BYTES: Final = 64 << 20
"""Most bytes of results that wait to be translated."""


class Framed(Protocol):
    """A result of one frame."""

    @property
    def header(self) -> Header:
        """The frame's header."""


class Addressed(Protocol):
    """A message to one robot."""

    @property
    def robot(self) -> str:
        """The robot's name."""


R_contra = TypeVar("R_contra", contravariant=True)
A_contra = TypeVar("A_contra", bound=Addressed, contravariant=True)


class NotNowError(Exception):
    """A result that is refused because of when it was sent. The text is the reason that it is counted under."""


class Novelty(Protocol[R_contra]):
    """Memory of the results that a stream has returned."""

    def is_new(self, result: R_contra) -> bool:
        """Return whether a result has not been returned yet.

        Raises:
            SchemaError: it speaks of another robot or camera than its key.
            NotNowError: it is not of now.
        """

    def remember(self, result: R_contra) -> None:
        """Note that a result was returned."""


class NewerFrames:
    """Accepts only newer frames, within each life of the gateway that sent them."""

    def __init__(self, camera: CameraKey) -> None:
        self._camera = camera
        self._order = FrameOrder()

    def is_new(self, result: Framed) -> bool:
        """Return whether a result is of a newer frame, or of another gateway process."""
        codec.check_identity(result.header, self._camera)
        return self._order.admits(result.header, time.monotonic_ns())

    def remember(self, result: Framed) -> None:
        """Note the result's frame."""
        self._order.note(result.header, time.monotonic_ns())


class UnseenMessages(Generic[A_contra]):
    """Accepts each message once, even from other senders; the last 1,024 are remembered.

    identify: what makes two messages the same.
    """

    def __init__(self, key: RobotStreamKey, identify: Callable[[A_contra], Hashable]) -> None:
        self._key = key
        self._identify = identify
        self._seen: OrderedDict[Hashable, None] = OrderedDict()

    def is_new(self, result: A_contra) -> bool:
        """Return whether the message is not among those remembered."""
        codec.check_robot(result.robot, self._key)
        return self._identify(result) not in self._seen

    def remember(self, result: A_contra) -> None:
        """Note a message, and forget the oldest one if there are too many."""
        self._seen[self._identify(result)] = None
        if len(self._seen) > MAX_REMEMBERED:
            self._seen.popitem(last=False)


R = TypeVar("R", bound=codec.Message)


def anywhere(_: codec.Message) -> str:
    """Route every result to the stream's only topic."""
    return ""


@dataclass(frozen=True, slots=True)
class Translator(Generic[R]):
    """Makes messages of one ROS type from one stream of results.

    translate: given a result and its number (from 1, as rospy counts what it publishes), returns the serialised ROS
        message. Raises SchemaError or MessageError for a result that cannot become one.
    heavy: takes more than a millisecond or two, so it is done in a thread.
    route: names which of the stream's topics a result is for.
    waiting: how many results wait for the gateway, and messages for each ROS subscriber; of more, the newest.
    latched: the last one is for latecomers too, on ROS and from Zenoh. Only for messages that say of when they are.
    eager: taken from Zenoh though no ROS subscriber is there.
    """

    schema: type[R]
    ros_type: str
    translate: Callable[[R, int], bytes]
    heavy: bool = False
    route: Callable[[R], str] = anywhere
    waiting: int = 1
    latched: bool = False
    eager: bool = False

    @property
    def keep(self) -> Latest | Queue:
        """The queue policy of waiting results."""
        return LATEST if self.waiting == 1 else QUEUE(self.waiting, WAITING_BYTES)


log = logging.getLogger(__name__)

MALFORMED: Final = "malformed"
DOUBLED: Final = "returned already, or of an older frame"
REFUSED: Final = "not allowed by the gateway's settings"
UNHEARD: Final = "nobody on ROS subscribed to its topic"
REPLACED: Final = "replaced by a newer one before the gateway took it"
SLOW: Final = "replaced by a newer one before a slow ROS subscriber took it"


class StreamReturn(Generic[R]):
    """Decides on a stream's results. After each `receive`, call `returned`, `leave_out` or `unheard`.

    topics: by route (see Translator) where results go on ROS; those of another route are refused.
    """

    def __init__(
        self, key: StreamKey | RobotStreamKey, translator: Translator[R], novelty: Novelty[R], topics: Mapping[str, str]
    ) -> None:
        self.key = key
        self.translator = translator
        self.topics = topics
        self._novelty = novelty
        self._received = 0
        self._published = 0
        self._dropped: Counter[str] = Counter()

    def receive(self, payload: bytes, encoding: str, replaced: int) -> R | None:
        """Return a result to pass on, or None if it is malformed, duplicate or refused, which is counted.

        replaced: how many results newer ones replaced since the last one taken.
        """
        self._received += 1 + replaced
        self._dropped[REPLACED] += replaced
        try:
            result = codec.decode(self.translator.schema, payload, encoding)
            new = self._novelty.is_new(result)
        except SchemaError as error:
            self.leave_out(error)
            return None
        except NotNowError as error:
            self._dropped[str(error)] += 1
            log.warning("%s: refused: %s", self.key, error)
            return None
        if not new:
            self._dropped[DOUBLED] += 1
        elif (route := self.translator.route(result)) not in self.topics:
            self._dropped[REFUSED] += 1
            log.warning(
                "%s: %r refused: the gateway's settings do not allow it; --actions NAME=TOPIC would", self.key, route
            )
        else:
            return result
        return None

    def topic_of(self, result: R) -> str:
        """Return the ROS topic of a result."""
        return self.topics[self.translator.route(result)]

    @property
    def next_number(self) -> int:
        """The number of the message that is returned next."""
        return self._published + 1

    def returned(self, result: R) -> None:
        """Note that a result was returned."""
        self._novelty.remember(result)
        self._published += 1

    def leave_out(self, error: Exception) -> None:
        """Note that a result cannot be returned."""
        self._dropped[MALFORMED] += 1
        log.warning("%s: result left out: %s", self.key, error)

    def unheard(self, result: R) -> None:
        """Note that a result had no subscriber."""
        self._dropped[UNHEARD] += 1
        log.warning("%s: nobody subscribes to %s", self.key, self.topic_of(result))

    def retire(self, *, slow: int) -> None:
        """Add the final counts (see `status`) of ended publications to the stream's."""
        self._dropped[SLOW] += slow

    def status(self, *, wanted: bool, subscribers: int, slow: int) -> ReturnStatus:
        """Return the stream's status, which accounts for every message.

        slow: how many were replaced while they waited for a ROS subscriber; counts given to `retire` are added.
        """
        return ReturnStatus(
            camera=owner_of(self.key)[1],
            stream=self.key.stream,
            topic=", ".join(self.topics.values())[:MAX_LABEL],
            wanted=wanted,
            subscribers=subscribers,
            received=self._received,
            published=self._published,
            dropped=dict(self._dropped + Counter({SLOW: slow})),
        )
