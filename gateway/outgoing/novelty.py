"""Which results are whose they say, and which of them were returned already. Pure."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Final, Generic, Protocol, TypeVar

from schemas import codec
from schemas.header import Header, is_newer
from schemas.keys import CameraKey, RobotStreamKey

MAX_REMEMBERED: Final = 1_024


class Framed(Protocol):
    """A result of one frame."""

    @property
    def header(self) -> Header:
        """Which frame that is."""


class Addressed(Protocol):
    """A message to one robot."""

    @property
    def robot(self) -> str:
        """Which robot that is."""


R_contra = TypeVar("R_contra", contravariant=True)
A_contra = TypeVar("A_contra", bound=Addressed, contravariant=True)


class Novelty(Protocol[R_contra]):
    """What a stream has returned so far."""

    def is_new(self, result: R_contra) -> bool:
        """Whether a result is one that was not returned yet.

        Raises:
            SchemaError: it speaks of another robot or camera than its key.
        """

    def remember(self, result: R_contra) -> None:
        """Take note that a result was returned."""


class NewerFrames:
    """Frames only go forward, within each life of the gateway that sent them."""

    def __init__(self, camera: CameraKey) -> None:
        self._camera = camera
        self._last: Header | None = None

    def is_new(self, result: Framed) -> bool:
        """Whether it is of a newer frame, or of another gateway process."""
        codec.check_identity(result.header, self._camera)
        return is_newer(result.header, self._last)

    def remember(self, result: Framed) -> None:
        """Take note of its frame."""
        self._last = result.header


class UnseenMessages(Generic[A_contra]):
    """Each message once, whoever sends it again; the last 1,024 are remembered.

    identify: what makes two messages the same.
    """

    def __init__(self, key: RobotStreamKey, identify: Callable[[A_contra], Hashable]) -> None:
        self._key = key
        self._identify = identify
        self._seen: OrderedDict[Hashable, None] = OrderedDict()

    def is_new(self, result: A_contra) -> bool:
        """Whether no such message is remembered."""
        codec.check_robot(result.robot, self._key)
        return self._identify(result) not in self._seen

    def remember(self, result: A_contra) -> None:
        """Take note of a message, and forget the oldest one when there are too many."""
        self._seen[self._identify(result)] = None
        if len(self._seen) > MAX_REMEMBERED:
            self._seen.popitem(last=False)
