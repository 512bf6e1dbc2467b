"""How one kind of result becomes ROS messages."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from bus import LATEST, QUEUE
from bus.api import Latest, Queue
from schemas import codec

R = TypeVar("R", bound=codec.Message)


def anywhere(_: codec.Message) -> str:
    """Send every result of a stream the same way."""
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
    unasked: taken from Zenoh though no ROS subscriber is there.
    """

    schema: type[R]
    ros_type: str
    translate: Callable[[R, int], bytes]
    heavy: bool = False
    route: Callable[[R], str] = anywhere
    waiting: int = 1
    latched: bool = False
    unasked: bool = False

    @property
    def keep(self) -> Latest | Queue:
        """What waits for the gateway."""
        return LATEST if self.waiting == 1 else QUEUE(self.waiting)
