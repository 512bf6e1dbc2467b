"""Caches are asked some at a time, on a real session."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
import zenoh
from zenoh.handlers import Callback

from bus.history import caches
from bus.history.caches import ASKED_AT_ONCE, SLOW_S, Caches
from bus.history.key_state import Fetch
from tests.waiting import until

RECOVER = 3
MORE = 4
PLACE = "abc/1"


def cache_of(key: str) -> str:
    return f"{key}/@adv/pub/{PLACE}/_"


class Asked:
    """Caches whose queries wait to be answered, and who asks them."""

    def __init__(self, session: zenoh.Session, thread: ThreadPoolExecutor) -> None:
        self.session = session
        self.queries: list[zenoh.Query] = []
        self.answers: list[tuple[str, bytes]] = []
        self.answered: list[str] = []
        self.waiting: list[Callable[[], None]] = []
        self.empty: list[str] = []
        self._thread = thread
        self.caches = Caches(thread.submit, self._later, RECOVER, self._on_answer, self._on_answered)
        session.declare_queryable(cache_of("*"), Callback(self.queries.append, indirect=False))
        self.use(session)

    def _later(self, _: float, call: Callable[[], None]) -> None:
        self.waiting.append(call)

    def pass_time(self) -> None:
        """Have what was to be done later be done now."""
        calls, self.waiting = self.waiting, []
        for call in calls:
            self._thread.submit(call).result()

    def _on_answer(self, fetch: Fetch, sample: zenoh.Sample) -> None:
        self.answers.append((fetch.key, sample.payload.to_bytes()))

    def _on_answered(self, fetch: Fetch, replied: bool) -> None:  # noqa: FBT001 - a callback's
        self.answered.append(fetch.key)
        if not replied:
            self.empty.append(fetch.key)

    def use(self, session: zenoh.Session | None) -> None:
        self._thread.submit(self.caches.use, session).result()

    def ask(self, key: str, *taken: tuple[int | str, int]) -> None:
        self.caches.ask(Fetch(key, cache_of(key), taken))

    def end(self, query: zenoh.Query, *payloads: bytes) -> None:
        """Answer one; with nothing more it is known that there is no more."""
        self.queries.remove(query)
        for payload in payloads:
            query.reply("key", payload)
        query.drop()


@contextmanager
def asked() -> Iterator[Asked]:
    config = zenoh.Config.from_json5('{mode: "peer", scouting: {multicast: {enabled: false}}}')
    with ThreadPoolExecutor(1) as thread, zenoh.open(config) as session:
        yield Asked(session, thread)


async def test_some_are_asked_at_once_and_the_others_in_their_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caches, "SLOW_S", 3_600)
    with asked() as those:
        for number in range(ASKED_AT_ONCE + MORE):
            those.ask(str(number))
        await until(lambda: len(those.queries) >= ASKED_AT_ONCE)
        for number in range(ASKED_AT_ONCE + MORE):
            await until(lambda: those.queries)
            assert len(those.queries) <= ASKED_AT_ONCE
            those.end(those.queries[0], b"%d" % number)
        await until(lambda: len(those.answered) == ASKED_AT_ONCE + MORE)
        assert sorted(those.answered) == sorted(str(number) for number in range(ASKED_AT_ONCE + MORE))
        assert len(those.answers) == ASKED_AT_ONCE + MORE


async def test_those_that_do_not_answer_hold_up_the_others_for_a_moment_only(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [0.0]
    monkeypatch.setattr(caches, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(caches, "MOST_ASKED", 2 * ASKED_AT_ONCE)
    with asked() as those:
        for number in range(3 * ASKED_AT_ONCE):
            those.ask(str(number))
        for most in (ASKED_AT_ONCE, 2 * ASKED_AT_ONCE, 2 * ASKED_AT_ONCE):
            those.pass_time()
            await until(lambda most=most: len(those.queries) >= most)  # type: ignore[misc]
            those.pass_time()
            assert len(those.queries) == most, "no more than MOST_ASKED, however slow they are"
            now_s[0] += SLOW_S
        those.end(those.queries[0], b"1")
        await until(lambda: len(those.answered) == 1 and len(those.queries) == 2 * ASKED_AT_ONCE)
        for ended in range(1, 3 * ASKED_AT_ONCE):
            await until(lambda: those.queries)
            those.end(those.queries[0])
            await until(lambda ended=ended: len(those.answered) > ended)  # type: ignore[misc]


@pytest.mark.parametrize(
    ("taken", "numbers"),
    [([], None), ([("abc/1", 4), ("other/1", 9)], "5.."), ([("other/1", 9)], None), ([(1, 7), (2, 9)], "8..")],
)
async def test_they_are_asked_for_what_came_after_their_own_last(
    taken: list[tuple[int | str, int]], numbers: str | None
) -> None:
    """Of the publishers with the cache's session and id, or of ours with this id."""
    with asked() as those:
        those.ask("key", *taken)
        await until(lambda: those.queries)
        parameters = those.queries[0].parameters
        assert (parameters.get("_sn"), parameters.get("_max")) == (numbers, str(RECOVER))
        those.end(those.queries[0], b"5", b"6")
        await until(lambda: those.answered == ["key"])
        assert those.answers == [("key", b"5"), ("key", b"6")]


async def test_one_that_answers_with_more_than_it_was_asked_for_is_heard_so_far() -> None:
    with asked() as those:
        those.ask("key")
        await until(lambda: those.queries)
        those.end(those.queries[0], *(b"%d" % number for number in range(RECOVER + MORE)))
        await until(lambda: those.answered == ["key"])
        assert those.answers == [("key", b"%d" % number) for number in range(RECOVER)]


async def test_whether_one_had_anything_is_told() -> None:
    with asked() as those:
        for key, payloads in (("nothing", ()), ("something", (b"1",))):
            those.ask(key)
            await until(lambda: those.queries)
            those.end(those.queries[0], *payloads)
        await until(lambda: len(those.answered) == 2)
        assert those.empty == ["nothing"]


async def test_what_was_asked_on_a_session_that_is_over_is_answered_by_nobody() -> None:
    with asked() as those:
        those.ask("key")
        await until(lambda: those.queries)
        those.use(None)
        those.ask("nobody's")
        those.end(those.queries[0], b"late")
        those.use(those.session)
        those.ask("next")
        await until(lambda: those.queries)
        those.end(those.queries[0], b"new")
        await until(lambda: those.answered == ["next"])
        assert those.answers == [("next", b"new")]


async def test_one_that_cannot_be_asked_holds_up_none() -> None:
    with asked() as those:
        those.ask("no//key")
        those.ask("key")
        await until(lambda: those.queries)
        those.end(those.queries[0])
        await until(lambda: those.answered == ["no//key", "key"])
