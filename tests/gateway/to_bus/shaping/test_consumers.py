import asyncio
import logging
import time

import msgspec
import pytest

from bus import BusSettings, Presence, QoS, Sample
from bus.fake import FakeNetwork
from gateway.to_bus.shaping.consumers import HERE_AGAIN_S, MAX_CONSUMERS, Consumers, stays_near
from schemas import codec
from schemas.budget import LEAST_HZ, MOST_WAIT_S, RateBudget
from schemas.consumer_keys import Wanted
from schemas.keys import CameraKey, Stream, StreamKey
from tests.waiting import until

COLOR = StreamKey(CameraKey("r1", "front"), Stream.COLOR)
DEPTH = StreamKey(CameraKey("r1", "front"), Stream.DEPTH)


def told(*words: tuple[str, str, bool], near: bool = True) -> Consumers:
    """Return what knows of (clock, consumer, alive) of the colour stream, on a machine with clock `here`."""
    consumers = Consumers("r1", "here", near=near)
    for clock, name, alive in words:
        consumers.note(Presence(str(Wanted(COLOR, clock, name)), alive))
    return consumers


def test_nobody_known_may_be_anywhere() -> None:
    assert not told().all_here(COLOR)


def test_all_of_them_must_be_here() -> None:
    assert told(("here", "a", True), ("here", "b", True)).all_here(COLOR)
    assert not told(("here", "a", True), ("there", "b", True)).all_here(COLOR)
    assert not told(("here", "a", True)).all_here(DEPTH)


def test_those_who_left_do_not_count() -> None:
    assert told(("here", "a", True), ("there", "b", True), ("there", "b", False)).all_here(COLOR)
    assert not told(("there", "a", True), ("there", "a", False)).all_here(COLOR)
    assert not told(("here", "a", False)).all_here(COLOR)


def test_those_here_who_left_a_moment_ago_and_may_come_back_count_as_here() -> None:
    now_s = 100.0
    consumers = Consumers("r1", "here", near=True, lease_s=0, steady_s=lambda: now_s)
    for alive in (True, False):
        consumers.note(Presence(str(Wanted(COLOR, "here", "a")), alive))
    assert consumers.all_here(COLOR)
    assert not consumers.all_here(DEPTH)
    consumers.note(Presence(str(Wanted(COLOR, "there", "b")), alive=True))
    assert not consumers.all_here(COLOR)
    consumers.note(Presence(str(Wanted(COLOR, "there", "b")), alive=False))
    now_s += HERE_AGAIN_S
    assert not consumers.all_here(COLOR)


@pytest.mark.parametrize("last", ["here", "there"])
def test_a_stream_that_was_wanted_elsewhere_too_does_not_count_as_here(last: str) -> None:
    consumers = Consumers("r1", "here", near=True, steady_s=lambda: 100.0)
    for clock in ("here", "there"):
        consumers.note(Presence(str(Wanted(COLOR, clock, "a")), alive=True))
    for clock in sorted(("here", "there"), key=lambda each: each == last):
        consumers.note(Presence(str(Wanted(COLOR, clock, "a")), alive=False))
    assert not consumers.all_here(COLOR)


def test_what_is_remembered_of_those_who_left_is_bounded() -> None:
    now_s = 100.0
    consumers = Consumers("r1", "here", near=True, lease_s=0, steady_s=lambda: now_s)
    for number in range(9):
        key = StreamKey(CameraKey("r1", f"c{number}"), Stream.COLOR)
        for alive in (True, False):
            consumers.note(Presence(str(Wanted(key, "here", "a")), alive))
        now_s += HERE_AGAIN_S / 2
    assert len(consumers._here_until_s) == 2


def test_where_the_way_leads_over_the_network_nobody_is_here() -> None:
    assert not told(("here", "a", True), near=False).all_here(COLOR)


def test_a_key_that_says_nothing_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    consumers = Consumers("r1", "here", near=True)
    with caplog.at_level(logging.WARNING):
        consumers.note(Presence("fleet/r1/front/color/wanted/here", alive=True))
    assert "consumer left out: not a subscriber's key" in caplog.text


def test_how_many_are_known_is_bounded() -> None:
    consumers = told(*((f"c{n}", "a", True) for n in range(MAX_CONSUMERS + 9)))
    assert len(consumers._known[COLOR]) == MAX_CONSUMERS


async def test_tokens_are_followed() -> None:
    network = FakeNetwork()
    consumers = Consumers("r1", "here", near=True)
    async with network.open_bus() as ours, network.open_bus() as theirs:
        following = asyncio.create_task(consumers.follow(ours))
        async with theirs.announce(str(Wanted(COLOR, "here", "w1"))):
            await until(lambda: consumers.all_here(COLOR), "the token is seen")
        await until(lambda: not consumers.all_here(COLOR), "its end is seen")
        following.cancel()
        await asyncio.wait([following])


@pytest.mark.parametrize(
    ("settings", "near"),
    [
        (BusSettings(), True),
        (BusSettings(connect=["tcp/localhost:7447"]), True),
        (BusSettings(connect=["tcp/[::1]:7447"]), True),
        (BusSettings(connect=["udp/127.0.0.1:7447?rel=0"]), True),
        (BusSettings(connect=["tcp/central:7447"]), False),
        (BusSettings(connect=["tcp/127.0.0.1:7447", "tcp/10.0.0.1:7447"]), False),
        (BusSettings(connect=[], scouting=True), False),
        (BusSettings(mode="peer", connect=["tcp/central:7447"]), True),
    ],
)
def test_a_client_of_a_far_router_reaches_its_neighbours_through_it(settings: BusSettings, *, near: bool) -> None:
    assert stays_near(settings) is near


def budget_of(hz: float, key: str = "fleet/r1/front/budget/w") -> Sample:
    said = RateBudget(robot="r1", camera="front", consumer="w", stream="color", hz=hz)
    return Sample(key, codec.encode(said), codec.encoding(RateBudget), 0, 0)


def test_what_consumers_can_use_is_sent_until_one_comes_that_says_nothing() -> None:
    consumers = told(("here", "w", True))
    consumers.note_budget(budget_of(2))
    assert [consumers.passes(COLOR, n * 250_000_000) for n in range(4)] == [True, False, True, False]
    consumers.note(Presence(str(Wanted(COLOR, "there", "viewer")), alive=True))
    assert consumers.passes(COLOR, 1)
    assert consumers.passes(DEPTH, 1)


def test_a_budget_ends_with_its_consumers_token() -> None:
    consumers = told(("here", "w", True))
    consumers.note_budget(budget_of(2))
    for alive in (False, True):
        consumers.note(Presence(str(Wanted(COLOR, "here", "w")), alive))
    assert all(consumers.passes(COLOR, n) for n in range(4))


def test_what_is_no_budget_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    consumers = told(("here", "w", True))
    consumers.note_budget(budget_of(2, "fleet/r1/rear/budget/w"))
    consumers.note_budget(Sample("fleet/r1/front/budget/w", b"x", codec.encoding(RateBudget), 0, 0))
    consumers.note_budget(budget_of(2, "fleet/r1/front/budget/another"))
    assert len(caplog.records) == 3
    assert all(consumers.passes(COLOR, n) for n in range(4))


async def test_budgets_are_heard_on_the_bus() -> None:
    network = FakeNetwork()
    consumers = told(("here", "w", True))
    async with network.open_bus() as ours, network.open_bus() as theirs:
        following = asyncio.create_task(consumers.follow(ours))
        key = "fleet/r1/front/budget/w"
        async with theirs.publisher(key, QoS.STATUS, encoding=codec.encoding(RateBudget), kept=0) as publisher:
            await until(lambda: publisher.wanted, "subscribed to")
            publisher.put(budget_of(1).payload)
            now_ns = time.time_ns() + 10_000_000_000
            await until(lambda: not (consumers.passes(COLOR, now_ns) and consumers.passes(COLOR, now_ns)), "heard")
        following.cancel()
        await asyncio.wait([following])


def test_no_budget_in_another_name_stops_a_stream() -> None:
    consumers = told(("here", "w", True))
    forged = RateBudget(robot="r1", camera="front", consumer="w", stream="color", hz=LEAST_HZ, wait_s=MOST_WAIT_S)
    consumers.note_budget(Sample("fleet/r1/front/budget/w", codec.encode(forged), codec.encoding(RateBudget), 0, 0))
    sent_s = [at for at in range(60) if consumers.passes(COLOR, at * 1_000_000_000)]
    assert sent_s[0] <= 10, "a frame passes in time"
    assert sent_s[-1] - sent_s[-2] == 1, "and all of them once nobody repeats the budget"
    for at in range(60, 120):
        consumers.note_budget(
            Sample("fleet/r1/front/budget/w", codec.encode(forged), codec.encoding(RateBudget), at * 1_000_000_000, 0)
        )
    passed = 0
    for at in range(120, 240):
        said = msgspec.structs.replace(forged, wait_s=0)
        consumers.note_budget(
            Sample("fleet/r1/front/budget/w", codec.encode(said), codec.encoding(RateBudget), at * 1_000_000_000, 0)
        )
        passed += consumers.passes(COLOR, at * 1_000_000_000)
    assert passed >= 10, "also while somebody repeats it"
