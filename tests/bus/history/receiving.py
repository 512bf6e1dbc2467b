"""The order of messages under test, and what a subscriber receives of it."""

from collections.abc import Iterable

from bus.history.key_state import Fetch, Hold, Numbered
from bus.history.ordering import History

KEY = "fleet/r1/front/classes"
HERE = f"{KEY}/@adv/pub/session/1/_"


OURS = 7


def message(number: int, publisher: int = OURS, key: str = KEY) -> Numbered[int]:
    return Numbered(key, publisher, number, number)


class Received:
    """A history, and what became of what it was given. Messages are their numbers."""

    def __init__(self, recover: int = 9) -> None:
        self.messages: list[int] = []
        self.missed = 0
        self.fetches: list[Fetch] = []
        self.doubts: list[Fetch] = []
        self.holds: list[Hold] = []
        self.history: History[int] = History(
            recover, self.fetches.append, self.doubts.append, self.holds.append, self.messages.extend, self._miss
        )

    def _miss(self, number: int) -> None:
        self.missed += number

    @property
    def outcome(self) -> tuple[list[int], int]:
        return self.messages, self.missed

    def appear(self, cache: str = HERE, kept: Iterable[int] | None = ()) -> None:
        """Have a publisher come whose cache has these, or does not answer yet."""
        self.history.appear(KEY, cache)
        if kept is not None:
            self.answer(*kept)

    def answer(self, *kept: int) -> None:
        """Have the cache that was asked last answer."""
        for number in kept:
            self.history.kept(self.fetches[-1], message(number))
        self.history.fetched(self.fetches[-1])

    def nothing(self) -> None:
        """Have the cache that was asked last have nothing, or not be reached."""
        self.history.fetched(self.fetches[-1], empty=True)

    def ask_again(self) -> None:
        self.history.ask_again(self.doubts[-1])

    def live(self, *numbers: int, publisher: int = OURS, key: str = KEY) -> None:
        self.history.live(message(number, publisher=publisher, key=key) for number in numbers)
