"""Messages of a key with their publishers' numbers, and the state of the key and of its publishers. Pure."""

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Final, Generic, NamedTuple, TypeVar

PUBLISHERS_REMEMBERED: Final = 128
"""Most publishers remembered for one key, the latest heard; a gateway has up to 64, one per latching publisher."""

NONE: Final = -1
"""Stands for no number; less than any."""

FIRST: Final = 1
"""First number of our publishers; Zenoh's own numbers begin with 0."""

LATE_RUN: Final = 8
"""Live messages in a row, all numbered lower than the last one, after which their count is the one that goes on."""

M = TypeVar("M")


class Numbered(NamedTuple, Generic[M]):
    """A message with its publisher and the publisher's number of it, which grows by one."""

    key: str
    publisher: int | str
    number: int
    message: M


class Fetch(NamedTuple):
    """A query to a cache for the messages of a key after those that were taken.

    taken: publishers and the numbers of their last ones.
    """

    key: str
    cache: str
    taken: tuple[tuple[int | str, int], ...] = ()


class Hold(NamedTuple):
    """A time for which a key's live messages wait for older ones: its number among those of the key."""

    key: str
    number: int


@dataclass(slots=True)
class PublisherState:
    """State of one publisher.

    last: the number taken last. live: the newest number that came live since it appeared: newer ones
    come without asking. sought: the newest number that had come when a cache was last asked. kept: the newest that a
    cache had, so that live ones up to it are only late. late, run: the live message that came last although it is not
    newer than `last`, and how many of them came in a row.
    """

    last: int = NONE
    live: int = NONE
    sought: int = NONE
    kept: int = NONE
    late: int = NONE
    run: int = 0

    def is_behind_hole(self, number: int) -> bool:
        return self.last != NONE and number > self.last + 1

    def goes_on(self, number: int) -> bool:
        """Return whether live messages have gone on below `last` for LATE_RUN of them; then they are what counts.

        A message may have a number far ahead by a fault, or from somebody who speaks for the publisher. Trusted for
        ever, it would make all that the publisher sends old.
        """
        self.run = self.run + 1 if number == self.late + 1 else 1
        self.late = number
        if self.run < LATE_RUN:
            return False
        self.last = self.live = self.sought = number - 1
        self.late, self.run = NONE, 0
        return True

    def is_next(self, number: int, first: int) -> bool:
        return number <= first if self.last == NONE else number == self.last + 1


@dataclass(slots=True)
class KeyState(Generic[M]):
    """State of a key.

    caches: those of present publishers. asked: those with a pending query, and whether to query them once more.
    doubted: those that are present and had nothing at the first query.
    held: live messages that wait for their answers, None if none have to; kept: their answers. holds: how often live
    messages began to wait.
    """

    name: str
    publishers: OrderedDict[int | str, PublisherState] = field(default_factory=OrderedDict)
    caches: set[str] = field(default_factory=set)
    asked: dict[str, bool] = field(default_factory=dict)
    doubted: set[str] = field(default_factory=set)
    held: list[Numbered[M]] | None = None
    kept: list[Numbered[M]] = field(default_factory=list)
    holds: int = 0

    def publisher(self, name: int | str) -> PublisherState:
        known = self.publishers.get(name)
        if known is None:
            known = self.publishers[name] = PublisherState()
            if len(self.publishers) > PUBLISHERS_REMEMBERED:
                self.publishers.popitem(last=False)
        else:
            self.publishers.move_to_end(name)
        return known

    def out_of_sight(self) -> None:
        """Forget which live messages came: later ones may be missing."""
        for publisher in self.publishers.values():
            publisher.live = NONE
