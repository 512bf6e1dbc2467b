"""Histories of publishers that come, go and are cut off at random, against what was sent."""

from collections import deque
from collections.abc import Callable
from random import Random

import pytest

from bus.history.key_state import Fetch, Numbered
from bus.history.ordering import History

KEY = "fleet/r1/front/classes"
ALL = 1_000
PUBLISHERS = 3
RUNS = 100
STEPS = 200
REACHED_AT_ONCE = 0.8
"""How often the way to a cache is known as soon as the cache is."""

Message = tuple[int, int]


class Publisher:
    """A publisher whose sessions end: on each, a cache of its own has what it keeps."""

    def __init__(self, world: "World", name: int) -> None:
        self.world = world
        self.name = name
        self.number = 0
        self.sessions = 0
        self.kept: deque[Numbered[Message]] = deque(maxlen=world.kept)
        self.cache: str | None = None
        self.on_its_way: deque[Numbered[Message]] = deque()
        self.begin()

    def begin(self) -> None:
        self.sessions += 1
        self.cache = f"{KEY}/@adv/pub/{self.name}.{self.sessions}/1/_"
        self.world.tell(self.cache, self)

    def end(self) -> None:
        if self.cache is not None:
            self.world.tell(self.cache, None)
        self.cache = None

    def put(self) -> None:
        self.number += 1
        message = Numbered(KEY, self.name, self.number, (self.name, self.number))
        self.kept.append(message)
        if self.cache is not None and self.world.linked and self.world.random.random() >= self.world.lost:
            self.on_its_way.append(message)


class World:
    """Publishers, and a subscriber whose link is cut. Presences come before what is live, as on a link."""

    def __init__(self, seed: int, *, recover: int, kept: int, lost: float) -> None:
        self.random = Random(seed)  # noqa: S311 - no secret
        self.recover = recover
        self.kept = kept
        self.lost = lost
        self.linked = True
        self.got: dict[int, list[int]] = {name: [] for name in range(PUBLISHERS)}
        self.missed = 0
        self.fetches: list[Fetch] = []
        self.doubts: list[Fetch] = []
        self.tried: set[str] = set()
        self.history: History[Message] = History(
            recover, self.fetches.append, self.doubts.append, lambda _: None, self._deliver, self._miss
        )
        self.history.cut_off()
        self.publishers: list[Publisher] = []
        for name in range(PUBLISHERS):
            self.publishers.append(Publisher(self, name))
        self.history.all_appeared()

    def tell(self, cache: str, publisher: Publisher | None) -> None:
        if self.linked:
            (self.history.leave if publisher is None else self.history.appear)(KEY, cache)

    def step(self) -> None:
        acts: list[Callable[[], None]] = [self.random.choice(self.publishers).put] * 4
        if self.random.random() < 0.2:
            acts.append(self.cut if self.linked else self.mend)
        if self.random.random() < 0.3:
            publisher = self.random.choice(self.publishers)
            acts.append(publisher.begin if publisher.cache is None else publisher.end)
        self.random.choice(acts + self._arrivals())()

    def settle(self) -> None:
        """Let everybody be there and everything arrive."""
        self.lost = 0
        if not self.linked:
            self.mend()
        for publisher in self.publishers:
            if publisher.cache is None:
                publisher.begin()
        while acts := self._arrivals():
            self.random.choice(acts)()

    def newest(self) -> list[int]:
        """Return the number of the last message that came of each publisher."""
        return [max(numbers, default=0) for numbers in self.got.values()]

    def cut(self) -> None:
        self.linked = False
        self.fetches.clear()
        self.doubts.clear()
        self.tried.clear()
        for publisher in self.publishers:
            publisher.on_its_way.clear()

    def mend(self) -> None:
        self.linked = True
        self.history.cut_off()
        for publisher in self.publishers:
            if publisher.cache is not None:
                self.history.appear(KEY, publisher.cache)
        self.history.all_appeared()

    def _arrivals(self) -> list[Callable[[], None]]:
        live = [publisher for publisher in self.publishers if publisher.on_its_way]
        acts: list[Callable[[], None]] = [self._answer] * 2 if self.fetches else []
        acts += [lambda: self.history.ask_again(self.doubts.pop(0))] if self.doubts else []
        return acts + [lambda: self._arrive(self.random.choice(live))] * 2 if live else acts

    def _arrive(self, publisher: Publisher) -> None:
        count = min(self.random.randint(1, 4), len(publisher.on_its_way))
        self.history.live([publisher.on_its_way.popleft() for _ in range(count)])

    def _answer(self) -> None:
        fetch = self.fetches.pop(self.random.randrange(len(self.fetches)))
        asked = next((each for each in self.publishers if each.cache == fetch.cache), None)
        found: list[Numbered[Message]] = []
        if asked is not None and (fetch.cache in self.tried or self.random.random() < REACHED_AT_ONCE):
            after = dict(fetch.taken).get(asked.name, 0)
            found = [each for each in asked.kept if each.number > after][-self.recover :]
        self.tried.add(fetch.cache)
        for message in found:
            self.history.kept(fetch, message)
        self.history.fetched(fetch, empty=not found)

    def _deliver(self, messages: list[Message]) -> None:
        for name, number in messages:
            self.got[name].append(number)

    def _miss(self, number: int) -> None:
        self.missed += number


@pytest.mark.parametrize("lost", [0.0, 0.1])
@pytest.mark.parametrize(("recover", "kept"), [(1, 1), (1, 50), (3, 5), (ALL, ALL)])
def test_each_comes_once_in_order_and_what_did_not_is_counted(recover: int, kept: int, lost: float) -> None:
    for seed in range(RUNS):
        world = World(seed, recover=recover, kept=kept, lost=lost)
        for _ in range(STEPS):
            world.step()
        world.settle()
        if not lost:
            assert world.newest() == [each.number for each in world.publishers], f"seed {seed}"
        for publisher in world.publishers:  # behind what was lost last
            publisher.put()
        world.settle()
        assert world.newest() == [each.number for each in world.publishers], f"seed {seed}"
        missed = 0
        for numbers in world.got.values():
            assert numbers == sorted(set(numbers)), f"seed {seed}"
            missed += numbers[-1] - numbers[0] + 1 - len(numbers)
        assert world.missed == missed, f"seed {seed}"


def test_nothing_that_publishers_keep_is_lost_while_they_stay() -> None:
    for seed in range(RUNS):
        world = World(seed, recover=ALL, kept=ALL, lost=0.0)
        for _ in range(STEPS):
            world.random.choice([*[world.random.choice(world.publishers).put] * 3, *world._arrivals()])()
            if world.random.random() < 0.05:
                (world.cut if world.linked else world.mend)()
        world.settle()
        assert world.missed == 0, f"seed {seed}"
        assert world.got == {each.name: list(range(1, each.number + 1)) for each in world.publishers}, f"seed {seed}"
