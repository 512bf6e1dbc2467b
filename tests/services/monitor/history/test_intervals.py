from msgspec.structs import replace

from services.monitor.history.intervals import Interval, Sightings, interval_of
from services.monitor.history.ledger import Ledger
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting
from tests.services.monitor.inventory.seeing import FRONT, S

BOX = Sighting(key=FRONT, name="box", count=1, score=0.5, first_ns=S, since_ns=S, last_ns=2 * S, model="m", worker="w")


class Seen:
    """What is in view, and what is to be written of it."""

    def __init__(self) -> None:
        self.ledger = Ledger()
        self.sightings = Sightings(self.ledger)

    def change(
        self, kind: ChangeKind, *, since_s: int = 1, last_s: int = 2, count: int = 1, closest_m: float | None = None
    ) -> None:
        of = replace(BOX, count=count, since_ns=since_s * S, last_ns=last_s * S)
        self.sightings.take([Change(kind, of, closest_m=closest_m)])

    def told(self) -> list[tuple[int, int, int, bool]]:
        """Return what is to be written as (count, since, until, open), and take it as written."""
        some = [each for each in self.ledger.pending(100) if isinstance(each, Interval)]
        self.ledger.written(some)
        return [(each.count, each.since_ns // S, each.until_ns // S, each.open) for each in some]


def test_an_interval_lasts_as_long_as_the_count() -> None:
    seen = Seen()
    seen.change(ChangeKind.APPEARED)
    assert seen.told() == [(1, 1, 2, True)]
    seen.change(ChangeKind.COUNTED, count=3, since_s=5, last_s=6, closest_m=2.5)
    (one, _) = seen.ledger.pending(2)
    assert isinstance(one, Interval)
    assert one.closest_m == 2.5
    assert seen.told() == [(1, 1, 5, False), (3, 5, 6, True)]
    seen.change(ChangeKind.VANISHED, count=0, since_s=9, last_s=8, closest_m=1.5)
    (three,) = seen.ledger.pending(2)
    assert isinstance(three, Interval)
    assert three.closest_m == 1.5
    assert seen.told() == [(3, 5, 8, False)]


def test_what_is_lost_ends_when_it_was_seen_last() -> None:
    seen = Seen()
    seen.change(ChangeKind.APPEARED)
    seen.change(ChangeKind.LOST, last_s=7)
    assert seen.told() == [(1, 1, 7, False)]


def test_a_silent_cameras_intervals_end_and_go_on() -> None:
    seen = Seen()
    seen.change(ChangeKind.APPEARED)
    seen.sightings.pause([replace(BOX, last_ns=4 * S)])
    assert seen.told() == [(1, 1, 4, False)]
    seen.sightings.resume([replace(BOX, last_ns=9 * S)])
    assert seen.told() == [(1, 1, 9, True)]


def test_a_restored_interval_is_closed_when_its_sighting_ends() -> None:
    seen = Seen()
    seen.ledger.adopt([interval_of(BOX)])
    seen.change(ChangeKind.VANISHED, last_s=12)
    assert seen.told() == [(1, 1, 12, False)]


def test_a_restarted_monitor_knows_what_was_in_view() -> None:
    assert interval_of(BOX).sighting() == BOX
    assert replace(interval_of(BOX), open=False).sighting().count == 0


def test_what_goes_on_came_into_view_when_the_first_of_both_did() -> None:
    before, after = interval_of(BOX), interval_of(replace(BOX, since_ns=9 * S, first_ns=8 * S, last_ns=9 * S))
    assert after.is_as(before)
    assert after.going_on_from(before) == replace(after, since_ns=S, first_ns=S)
    assert not after.is_as(replace(before, count=2))
