import pytest
from msgspec.structs import replace

from schemas.keys import CameraKey
from services.monitor.history import intervals as module
from services.monitor.history.intervals import Interval, Ledger
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting
from tests.services.monitor.inventory.seeing import FRONT, S

BOX = Sighting(key=FRONT, name="box", count=1, score=0.5, first_ns=S, since_ns=S, last_ns=2 * S, model="m", worker="w")


def change(
    kind: ChangeKind, *, since_s: int = 1, last_s: int = 2, count: int = 1, closest_m: float | None = None
) -> Change:
    of = replace(BOX, count=count, since_ns=since_s * S, last_ns=last_s * S)
    return Change(kind, of, last_s * S, closest_m=closest_m)


def told(ledger: Ledger) -> list[tuple[int, int, int, bool]]:
    """Return what is to be written as (count, since, until, open), and take it as written."""
    some = ledger.pending(100)
    ledger.written(some)
    return [(each.count, each.since_ns // S, each.until_ns // S, each.open) for each in some]


def test_an_interval_lasts_as_long_as_the_count() -> None:
    ledger = Ledger()
    ledger.take([change(ChangeKind.APPEARED)])
    assert told(ledger) == [(1, 1, 2, True)]
    ledger.take([change(ChangeKind.COUNTED, count=3, since_s=5, last_s=6)])
    assert told(ledger) == [(1, 1, 5, False), (3, 5, 6, True)]
    ledger.take([change(ChangeKind.VANISHED, count=0, since_s=9, last_s=8, closest_m=1.5)])
    assert [each.closest_m for each in ledger.pending(1)] == [1.5]
    assert told(ledger) == [(3, 5, 8, False)]


def test_what_is_lost_ends_when_it_was_seen_last() -> None:
    ledger = Ledger()
    ledger.take([change(ChangeKind.APPEARED), change(ChangeKind.LOST, last_s=7)])
    assert told(ledger) == [(1, 1, 7, False)]


def test_a_silent_cameras_intervals_end_and_go_on() -> None:
    ledger = Ledger()
    ledger.take([change(ChangeKind.APPEARED)])
    ledger.pause([replace(BOX, last_ns=4 * S)])
    assert told(ledger) == [(1, 1, 4, False)]
    ledger.resume([replace(BOX, last_ns=9 * S)])
    assert told(ledger) == [(1, 1, 9, True)]


def test_what_changed_while_it_was_written_is_written_again() -> None:
    ledger = Ledger()
    ledger.take([change(ChangeKind.APPEARED)])
    under_way = ledger.pending(100)
    ledger.take([change(ChangeKind.VANISHED, last_s=8)])
    ledger.written(under_way)
    assert told(ledger) == [(1, 1, 8, False)]


def stored(count: int = 1, since_s: int = 1, key: CameraKey = FRONT) -> Interval:
    return Interval(key, "box", since_s * S, 2 * S, True, count, 0.5, None, S, "m", "w")  # noqa: FBT003 - open


@pytest.mark.parametrize(
    ("old", "heartbeat_s", "written"),
    [
        (stored(since_s=2), 8, [(1, 2, 5, True)]),
        (stored(since_s=5), 8, [(1, 5, 5, True)]),
        (stored(count=3, since_s=2), 4, [(3, 2, 4, False), (1, 5, 5, True)]),
        (stored(count=3, since_s=2), 8, [(3, 2, 5, False), (1, 5, 5, True)]),
        (stored(key=CameraKey("r9", "front")), 8, [(1, 1, 8, False), (1, 5, 5, True)]),
    ],
    ids=["same count", "same", "other count", "other count and late", "not here"],
)
def test_another_monitors_intervals_go_on_or_end(
    old: Interval, heartbeat_s: int, written: list[tuple[int, int, int, bool]]
) -> None:
    ledger = Ledger()
    ledger.take([change(ChangeKind.APPEARED, since_s=5, last_s=5)])
    ledger.forget_pending()
    ledger.merge([old], heartbeat_s * S, 9 * S, gap_ns=5 * S)
    assert told(ledger) == written


def test_over_a_long_gap_nothing_goes_on() -> None:
    ledger = Ledger()
    ledger.take([change(ChangeKind.APPEARED, since_s=105, last_s=105)])
    ledger.forget_pending()
    ledger.merge([stored()], 8 * S, 110 * S, gap_ns=60 * S)
    assert told(ledger) == [(1, 1, 8, False), (1, 105, 105, True)]


def test_what_happened_while_the_database_was_gone_is_kept() -> None:
    ledger = Ledger()
    ledger.take([change(ChangeKind.APPEARED)])
    assert told(ledger) == [(1, 1, 2, True)]
    ledger.take(
        [change(ChangeKind.COUNTED, count=2, since_s=3, last_s=3), change(ChangeKind.COUNTED, since_s=5, last_s=5)]
    )
    ledger.merge([stored()], 2 * S, 6 * S, gap_ns=60 * S)
    assert sorted(told(ledger), key=lambda each: each[1]) == [(1, 1, 3, False), (2, 3, 5, False), (1, 5, 5, True)]


def test_what_waits_is_bounded_and_the_oldest_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_PENDING", 2)
    ledger = Ledger()
    ledger.take([change(ChangeKind.COUNTED, count=n, since_s=n, last_s=n) for n in (1, 2, 3, 4)])
    assert (len(ledger), ledger.lost) == (2, 2)
    assert told(ledger) == [(3, 3, 4, False), (4, 4, 4, True)]


def test_a_restored_interval_is_closed_when_its_sighting_ends() -> None:
    ledger = Ledger()
    ledger.adopt([stored()])
    ledger.take([change(ChangeKind.VANISHED, last_s=12)])
    assert told(ledger) == [(1, 1, 12, False)]
    assert stored().sighting() == replace(BOX, last_ns=2 * S)
    assert replace(stored(), open=False).sighting().count == 0
