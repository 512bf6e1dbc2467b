"""Caches are asked some at a time, on a real session."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
import zenoh
from zenoh.handlers import Callback

from bus.caches import AT_ONCE, Caches
from bus.history import Fetch
from tests.contract.waiting import until

RECOVER = 3
MORE = 4


class Asked:
    """Caches whose queries wait to be answered, and who asks them."""

    def __init__(self, session: zenoh.Session, thread: ThreadPoolExecutor) -> None:
        self.session = session
        self.queries: list[zenoh.Query] = []
        self.answers: list[bytes] = []
        self.answered: list[str] = []
        self._thread = thread
        self.caches = Caches(thread.submit, RECOVER, self._on_answer, self.answered.append)
        session.declare_queryable("cache/*", Callback(self.queries.append, indirect=False))
        self.use(session)

    def _on_answer(self, sample: zenoh.Sample) -> None:
        self.answers.append(sample.payload.to_bytes())

    def use(self, session: zenoh.Session | None) -> None:
        self._thread.submit(self.caches.use, session).result()

    def ask(self, number: int, after: int | None = None) -> None:
        self.caches.ask(Fetch(f"cache/{number}", str(number), after))

    def end(self, query: zenoh.Query, *payloads: bytes) -> None:
        """Answer one; with nothing more it is known that there is no more."""
        self.queries.remove(query)
        for payload in payloads:
            query.reply(f"kept/{payload.decode()}", payload)
        query.drop()


@contextmanager
def asked() -> Iterator[Asked]:
    config = zenoh.Config.from_json5('{mode: "peer", scouting: {multicast: {enabled: false}}}')
    with ThreadPoolExecutor(1) as thread, zenoh.open(config) as session:
        yield Asked(session, thread)


async def test_some_are_asked_at_once_and_the_others_in_their_turn() -> None:
    with asked() as those:
        for number in range(AT_ONCE + MORE):
            those.ask(number)
        await until(lambda: len(those.queries) >= AT_ONCE)
        for number in range(AT_ONCE + MORE):
            await until(lambda: those.queries)
            assert len(those.queries) <= AT_ONCE
            those.end(those.queries[0], b"%d" % number)
        await until(lambda: len(those.answered) == AT_ONCE + MORE)
        assert sorted(those.answered) == sorted(str(number) for number in range(AT_ONCE + MORE))
        assert len(those.answers) == AT_ONCE + MORE


@pytest.mark.parametrize(("after", "numbers"), [(None, None), (4, "5..")])
async def test_they_are_asked_for_what_is_wanted(after: int | None, numbers: str | None) -> None:
    with asked() as those:
        those.ask(1, after)
        await until(lambda: those.queries)
        parameters = those.queries[0].parameters
        assert (parameters.get("_sn"), parameters.get("_max")) == (numbers, str(RECOVER))
        those.end(those.queries[0], b"5", b"6")
        await until(lambda: those.answered == ["1"])
        assert those.answers == [b"5", b"6"]


async def test_what_was_asked_on_a_session_that_is_over_is_answered_by_nobody() -> None:
    with asked() as those:
        those.ask(1)
        await until(lambda: those.queries)
        those.use(None)
        those.ask(2)  # by nobody
        those.end(those.queries[0], b"late")
        those.use(those.session)
        those.ask(3)
        await until(lambda: those.queries)
        those.end(those.queries[0], b"new")
        await until(lambda: those.answered == ["3"])
        assert those.answers == [b"new"]


async def test_one_that_cannot_be_asked_holds_up_none() -> None:
    with asked() as those:
        those.caches.ask(Fetch("no//key", "wrong", None))
        those.ask(1)
        await until(lambda: those.queries)
        those.end(those.queries[0])
        await until(lambda: those.answered == ["wrong", "1"])
