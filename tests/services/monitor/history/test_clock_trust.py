"""A clock that is far from when history was kept last: nothing is forgotten, and it is said."""

import time

import pytest

from schemas.alerts import AlertState
from services.monitor.history import row_maintenance
from services.monitor.history import upkeep as module
from services.monitor.history.clock_trust import DAY_NS, FAR_NS, ClockTrust, Correction, Doubt
from services.monitor.history.intervals import Interval
from services.monitor.history.state import Act, HistoryError
from services.monitor.history.store import Store
from tests.schemas.results import alert
from tests.services.monitor.history.support.monitoring import Monitor, attended, kept, monitoring, noted
from tests.services.monitor.history.support.stored_intervals import there
from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.inventory.seeing import S
from tests.waiting import until

KEPT_NS = 1_700_000_000 * S
AHEAD_NS = 60 * DAY_NS


def test_a_clock_that_goes_on_is_believed_and_one_that_leaps_is_not_until_it_is_back() -> None:
    clock = ClockTrust()
    clock.begin(0, None, 0)
    for second in range(3):
        assert clock.advance(KEPT_NS + second * S, second * S) is None
    assert clock.advance(KEPT_NS + AHEAD_NS + 4 * S, 4 * S) is None
    assert clock.doubt == Doubt(KEPT_NS + 4 * S, KEPT_NS + AHEAD_NS + 4 * S)
    assert "60 days ahead" in str(clock.doubt)
    assert clock.advance(KEPT_NS + AHEAD_NS + 5 * S, 5 * S) is None
    assert clock.advance(KEPT_NS + 7 * S, 7 * S) == Correction(KEPT_NS + AHEAD_NS // 2 + 4 * S, AHEAD_NS)
    assert clock.doubt is None


def test_a_monitor_that_was_off_for_long_is_told_that_its_clock_is_right() -> None:
    clock = ClockTrust()
    clock.begin(KEPT_NS, None, 0)
    clock.advance(KEPT_NS + AHEAD_NS, S)
    assert clock.doubt is not None
    assert clock.trust() is None, "what was kept since is right"
    assert clock.advance(KEPT_NS + AHEAD_NS + S, 2 * S) is None
    assert clock.doubt is None


def test_a_monitor_that_begins_with_its_clock_right_again_corrects_what_was_kept_meanwhile() -> None:
    clock = ClockTrust()
    clock.begin(KEPT_NS + AHEAD_NS + 9 * S, Doubt(KEPT_NS, KEPT_NS + AHEAD_NS), 0)
    correction = clock.advance(KEPT_NS + 30 * S, S)
    assert correction == Correction(KEPT_NS + AHEAD_NS // 2, AHEAD_NS)
    assert correction.corrected(KEPT_NS + AHEAD_NS + 5 * S) == KEPT_NS + 5 * S
    assert correction.corrected(KEPT_NS - 5 * S) == KEPT_NS - 5 * S


def test_a_clock_that_is_behind_until_the_network_sets_it_is_believed_then() -> None:
    clock = ClockTrust()
    clock.begin(KEPT_NS, None, 0)
    clock.advance(S, S)
    assert "behind" in str(clock.doubt)
    assert clock.advance(KEPT_NS + 60 * S, 20 * S) is None
    assert clock.doubt is None


def test_a_database_that_was_gone_for_long_says_nothing_of_the_clock() -> None:
    clock = ClockTrust()
    clock.begin(KEPT_NS, None, 0)
    clock.advance(KEPT_NS + S, S)
    long_ns = 2 * FAR_NS
    clock.begin(KEPT_NS, None, long_ns)
    clock.advance(KEPT_NS + long_ns, long_ns)
    assert clock.doubt is None


def test_a_small_step_back_and_an_operator_move_nothing_that_is_right() -> None:
    clock = ClockTrust()
    clock.begin(KEPT_NS, None, 0)
    now_ns = KEPT_NS + 20 * DAY_NS
    clock.advance(now_ns + 600 * S, S)
    assert clock.advance(now_ns + S, 2 * S) is None
    assert clock.doubt is not None
    assert clock.trust() is None, "ten minutes"
    assert clock.doubt is None


def test_an_operator_who_trusts_a_clock_that_was_set_back_has_what_was_kept_ahead_corrected_by_that() -> None:
    clock = ClockTrust()
    clock.begin(KEPT_NS, None, 0)
    now_ns = KEPT_NS + 20 * DAY_NS
    clock.advance(now_ns + AHEAD_NS, S)
    assert clock.advance(now_ns + 9 * S, 10 * S) is None
    assert clock.trust() == Correction(now_ns + AHEAD_NS // 2, AHEAD_NS)


def test_a_clock_that_was_ahead_from_the_first_start_on_is_corrected_once_an_operator_trusts_it() -> None:
    clock = ClockTrust()
    clock.begin(0, None, 0)
    clock.advance(KEPT_NS + AHEAD_NS, 0)
    assert clock.advance(KEPT_NS + S, S) is None
    assert "behind" in str(clock.doubt)
    assert clock.trust() == Correction(KEPT_NS + S + AHEAD_NS // 2, AHEAD_NS)


async def corrected(store: Store) -> None:
    """Have all be corrected."""
    while await store.correct():
        pass


async def test_much_is_corrected_slice_by_slice_also_by_the_next_monitor_and_once(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(row_maintenance, "CORRECTED_ROWS", 10)
    ahead = 100  # seconds; it was ahead for longer than that
    some = [interval(1_000 + 10 * number, 1_005 + 10 * number) for number in range(35)]
    done = [Act("a1", AlertState.ACKNOWLEDGED, "ann", (1_000 + number) * S) for number in range(25)]
    async with opened(url) as store:
        await store.write([interval(1, 2), *some], [alert(changed_ns=1_200 * S)], 1_400 * S, done)
        await store.end_clock_doubt(Correction(990 * S, ahead * S))
        assert await store.heartbeat_ns() == 1_300 * S
        for _ in range(3):
            assert await store.correct()
    async with opened(url) as store:
        await corrected(store)
        assert not await store.correct()
        found = [(each.since_ns // S, each.until_ns // S) for each in await store.select(Interval)]
        assert found == [(1, 2), *((900 + 10 * number, 905 + 10 * number) for number in range(35))]
        kept = await store.load(0)
        assert [act.at_ns // S for act in kept.acts] == list(range(900, 925))
        assert [each.changed_ns // S for each in kept.alerts] == [1_100]


async def test_what_comes_while_much_is_corrected_is_written_after_it(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(row_maintenance, "CORRECTED_ROWS", 5)
    monkeypatch.setattr(module, "CORRECT_S", 0.001)
    now_s = time.time_ns() // S
    some = [interval(now_s + 60 * 86_400 + number, now_s + 60 * 86_400 + number + 1) for number in range(40)]
    async with opened(url) as store:
        await store.write(some, [], now_s * S + AHEAD_NS)
        await store.write_clock_doubt(Doubt(now_s * S, now_s * S + AHEAD_NS))
    async with monitoring(url) as monitor:
        monitor.see(1, box=1)
        await until(lambda: monitor.history.status.leads)
        await until(monitor.written)
        async with opened(url) as store:
            assert not await store.correct(), "all is corrected"
    rows = await kept(url)
    assert len(rows) == len(some) + 1
    assert max(each.until_ns for each in rows) < (now_s + 86_400) * S


def test_acts_that_wait_are_corrected_too() -> None:
    monitor = Monitor("sqlite:////nowhere")
    monitor.history.act(Act("a1", AlertState.ACKNOWLEDGED, "ann", AHEAD_NS + S))
    monitor.history._correct(Correction(AHEAD_NS, AHEAD_NS), S)
    wanted = Act("a1", AlertState.ACKNOWLEDGED, "ann", S)
    assert (monitor.history.acts.of("a1"), monitor.history._alerts.snapshot()[1]) == ((wanted,), {wanted})


async def test_what_a_clock_that_was_ahead_had_kept_is_corrected_and_the_rest_stays(url: str) -> None:
    ahead = AHEAD_NS // S
    async with opened(url) as store:
        before = [interval(1, 2), there(1, 9, "r2")]
        wrong = [interval(ahead + 5, ahead + 6), there(ahead + 5, ahead + 7), there(8, ahead + 6, "r3")]
        resolved = alert(state=AlertState.RESOLVED, changed_ns=AHEAD_NS + 6 * S)
        await store.write([*before, *wrong], [resolved], AHEAD_NS + 8 * S)
        await store.end_clock_doubt(Correction(AHEAD_NS, AHEAD_NS))
        await corrected(store)
        assert await store.heartbeat_ns() == 8 * S
        assert [(each.since_ns // S, each.until_ns // S) for each in await store.select(type(before[0]))] == [
            (1, 2),
            (5, 6),
        ]
        assert await store.last_present() == {("r1", ""): 7 * S, ("r2", ""): 9 * S, ("r3", ""): 6 * S}


async def test_with_a_clock_far_ahead_nothing_is_forgotten_until_an_operator_says_so(
    url: str,
) -> None:
    now_s = time.time_ns() // S
    async with opened(url) as store:
        await store.write([interval(now_s - 61 * 86_400, now_s - 60 * 86_400)], [], now_s * S - AHEAD_NS)
    async with monitoring(url) as monitor:
        await until(lambda: bool(monitor.history.status.warnings))
        (warning,) = monitor.history.status.warnings
        assert "60 days ahead" in warning
        assert "trust-clock" in warning
        monitor.see(1, box=1)
        await until(monitor.written)
    assert len(await kept(url)) == 2, "history goes on"
    async with monitoring(url) as monitor:
        await until(lambda: bool(monitor.history.status.warnings))
        assert len(await kept(url)) == 2, "the next one knows, too"
        async with opened(url) as store:
            assert await store.trust_clock()
        await until(lambda: not monitor.history.status.warnings)
        await pruned(monitor)
    (only,) = await kept(url)
    assert only.since_ns > now_s * S - DAY_NS


async def pruned(monitor: Monitor) -> None:
    await until(lambda: monitor.history._upkeep._due_s > time.monotonic() + 2 * module.RETRY_S)


async def test_robots_were_last_seen_when_they_were_after_a_clock_that_was_ahead_for_a_while(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with monitoring(url) as monitor:
        await until(lambda: monitor.history.status.leads)
        await until(monitor.written)
    real_ns = time.time_ns
    with monkeypatch.context() as patch:
        patch.setattr(time, "time_ns", lambda: real_ns() + AHEAD_NS)
        async with monitoring(url) as monitor:
            monitor.inventory.robot_presence("r1", alive=True)
            monitor.see(1, box=1)
            await noted(monitor)
            await until(lambda: bool(monitor.history.status.warnings))
            await until(monitor.written)
            assert max(each.since_ns for each in await kept(url)) > real_ns() + AHEAD_NS - DAY_NS
            patch.setattr(time, "time_ns", real_ns)
            monitor.inventory.tick(real_ns())
            await until(lambda: not monitor.history.status.warnings)
            monitor.see(2, box=2)
            monitor.inventory.robot_presence("r1", alive=False)
            await noted(monitor)
            await until(monitor.written)
    rows = await kept(url)
    assert max(each.until_ns for each in rows) <= real_ns(), rows
    (seen,) = await attended(url, ("r1", ""))
    assert real_ns() - DAY_NS < seen.since_ns < seen.until_ns <= real_ns()
    async with monitoring(url) as monitor:
        assert monitor.inventory.recalled()["r1"] <= real_ns()
        await until(lambda: monitor.history.status.leads)


async def test_where_old_history_cannot_be_forgotten_it_is_said_and_history_goes_on(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def refuse(_store: Store, _before_ns: int) -> bool:
        raise HistoryError("too slow")

    monkeypatch.setattr(Store, "prune", refuse)
    async with monitoring(url) as monitor:
        await until(lambda: bool(monitor.history.status.warnings))
        assert "not forgotten: too slow" in monitor.history.status.warnings[0]
        monitor.see(1, box=1)
        await until(monitor.written)
        assert monitor.history.status.problem == ""
        monkeypatch.undo()
        monitor.history._upkeep._due_s = 0.0
        await until(lambda: not monitor.history.status.warnings)
    assert len(await kept(url)) == 1
