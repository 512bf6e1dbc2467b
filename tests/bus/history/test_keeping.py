"""Caches answer on a real session, as Zenoh's own do."""

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
import zenoh
from zenoh import ext

from bus import QUEUE, QoS, open_bus
from bus.history.keeping import RESUMED_S, CacheServer, EndedPublishers, KeptMessages
from bus.history.numbering import CACHE, stamp_of
from bus.presence.own_tokens import OwnTokens
from bus.zenoh_bus import ZenohBus
from tests.bus.sessions import client, router
from tests.contract.conftest import free_endpoint
from tests.waiting import next_of, until

KEY = "fleet/r1/front/classes"
PREFIX = "fleet/r1"


def test_who_follows_on_a_key_goes_on_with_what_was_kept_for_a_while() -> None:
    now_s = 0.0
    ended = EndedPublishers(lambda: now_s)
    first = ended.messages(KEY, "text", 3)
    first.add(b"one")
    ended.add(first)
    assert ended.messages(KEY, "other", 3) is not first
    assert ended.messages(KEY, "text", 4) is not first
    assert ended.messages(KEY, "text", 3) is first
    assert ended.messages(KEY, "text", 3) is not first, "two at once"
    ended.add(first)
    now_s = RESUMED_S + 0.1
    assert ended.messages(KEY, "text", 3) is not first
    newest = ended.messages(KEY, "text", 1)
    ended.add(newest)
    assert ended.messages(KEY, "text", 1) is not newest


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    with zenoh.open(zenoh.Config.from_json5('{mode: "peer", scouting: {multicast: {enabled: false}}}')) as opened:
        yield opened


class Serving:
    """A session's caches, with its tokens."""

    def __init__(self, session: zenoh.Session, prefix: str) -> None:
        self._thread = ThreadPoolExecutor(1)
        self.tokens = OwnTokens(prefix, lambda _, call: self._thread.submit(call))
        self.caches = CacheServer(prefix, self.tokens)
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


def wait_for(event: threading.Event) -> None:
    event.wait(60)


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


async def test_it_answers_while_the_session_has_other_work() -> None:
    endpoint = free_endpoint()
    async with open_bus(router(endpoint)), open_bus(client(endpoint), prefix=PREFIX) as there:
        assert isinstance(there, ZenohBus)
        async with there.publisher(KEY, QoS.LATCHED) as out, open_bus(client(endpoint)) as here:
            out.put(b"kept")
            async with here.subscribe(KEY, QUEUE(9)) as first:
                assert (await next_of(first)).payload == b"kept"
            go_on = threading.Event()
            there._session.do(partial(wait_for, go_on))
            async with here.subscribe(KEY, QUEUE(9)) as second:
                assert (await next_of(second)).payload == b"kept"
            go_on.set()


async def test_what_a_lost_link_did_not_take_comes_in_order_from_a_robot_as_well() -> None:
    """New messages do not overtake what shows that older ones are kept."""
    endpoint = free_endpoint()
    async with (
        open_bus(client(endpoint), prefix=PREFIX) as robot,
        open_bus(client(endpoint)) as here,
        robot.publisher(KEY, QoS.RESULT, kept=99) as out,
        here.subscribe(KEY, QUEUE(99), recover=100, few=True) as lists,
    ):
        sent = 0
        for _ in range(3):
            async with open_bus(router(endpoint)):
                for _ in range(4):
                    out.put(b"%d" % sent)
                    sent += 1
                    await asyncio.sleep(0.01)
                heard = [(await next_of(lists)).payload for _ in range(4 if sent == 4 else 7)]
                assert heard[-1] == b"%d" % (sent - 1)
            await until(lambda: robot.link_problem and here.link_problem)
            for _ in range(3):
                out.put(b"%d" % sent)
                sent += 1
        assert lists.counts.missed == 0


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
