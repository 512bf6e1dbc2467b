"""Caches answer on a real session, as Zenoh's own do."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh
from zenoh import ext

from bus.history.keeping import CacheServer, KeptMessages
from bus.history.numbering import CACHE, stamp_of
from bus.presence.own_tokens import OwnTokens
from tests.contract.waiting import until

KEY = "fleet/r1/front/classes"
PREFIX = "fleet/r1"


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    with zenoh.open(zenoh.Config.from_json5('{mode: "peer", scouting: {multicast: {enabled: false}}}')) as opened:
        yield opened


class Serving:
    """A session's caches, with its tokens."""

    def __init__(self, session: zenoh.Session, prefix: str) -> None:
        self._thread = ThreadPoolExecutor(1)
        self.tokens = OwnTokens(prefix, lambda _, call: self._thread.submit(call))
        self.caches = CacheServer(prefix, self.tokens, self._thread.submit)
        self.tokens.declare(session)
        self.caches.declare(session)

    def end(self) -> None:
        self.caches.undeclare()
        self._thread.shutdown()


@pytest.fixture(params=["", PREFIX])
def serving(request: pytest.FixtureRequest, session: zenoh.Session) -> Iterator[Serving]:
    made = Serving(session, request.param)
    yield made
    made.end()


def numbers(session: zenoh.Session, selector: str) -> list[int]:
    """Return the numbers of what is answered, once all have finished."""
    replies = session.get(
        selector, accept_replies=zenoh.ReplyKeyExpr.ANY, consolidation=zenoh.ConsolidationMode.NONE, timeout=3_600
    )
    found = [stamp_of(reply.ok) for reply in replies if reply.ok is not None]
    return [stamped[1] for stamped in found if stamped is not None]


def kept_of(key: str, count: int, most: int = 5) -> KeptMessages:
    kept = KeptMessages(key, "text/plain", most)
    for number in range(count):
        kept.add(b"%d" % number)
    return kept


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ("", [3, 4, 5, 6, 7]),
        ("?_max=2", [6, 7]),
        ("?_sn=5..;_max=100", [5, 6, 7]),
        ("?_sn=4..5", [4, 5]),
        ("?_sn=..4", [3, 4]),
        ("?_sn=8..", []),
        ("?_sn=nonsense;_max=more", [3, 4, 5, 6, 7]),
        ("?_max=0", []),
    ],
)
def test_the_newest_are_given_by_number_and_count(
    session: zenoh.Session, serving: Serving, parameters: str, expected: list[int]
) -> None:
    serving.caches.add(kept_of(KEY, 7))
    assert numbers(session, f"{KEY}{CACHE}**{parameters}") == expected


def test_one_is_told_from_the_others_by_its_key(session: zenoh.Session, serving: Serving) -> None:
    mine = kept_of(KEY, 1)
    serving.caches.add(mine)
    serving.caches.add(kept_of(KEY, 2))
    serving.caches.add(kept_of(f"{PREFIX}/status", 3))
    assert numbers(session, f"{KEY}{CACHE}*/{mine.publisher}/_") == [1]
    assert sorted(numbers(session, f"{KEY}/@adv/**")) == [1, 1, 2]
    assert sorted(numbers(session, f"{PREFIX}/**/@adv/**")) == [1, 1, 1, 2, 2, 3]


def test_what_is_removed_answers_no_more(session: zenoh.Session, serving: Serving) -> None:
    remove = serving.caches.add(kept_of(KEY, 1))
    serving.caches.add(kept_of(KEY, 2))
    remove()
    assert numbers(session, f"{KEY}{CACHE}**") == [1, 2]


def test_a_key_outside_the_prefix_has_a_cache_of_its_own(session: zenoh.Session) -> None:
    made = Serving(session, PREFIX)
    made.caches.add(kept_of("services/monitor/inventory", 1))
    assert numbers(session, f"services/**{CACHE}**") == [1]
    made.end()


async def test_zenohs_advanced_subscriber_gets_the_history(session: zenoh.Session, serving: Serving) -> None:
    serving.caches.add(kept_of(KEY, 3))
    got: list[bytes] = []
    subscriber = ext.declare_advanced_subscriber(
        session, KEY, lambda sample: got.append(sample.payload.to_bytes()), history=ext.HistoryConfig(max_samples=2)
    )
    await until(lambda: got == [b"1", b"2"])
    subscriber.undeclare()
