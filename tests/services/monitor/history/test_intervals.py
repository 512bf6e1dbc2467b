"""Sightings and disagreements as intervals."""

from msgspec.structs import replace

from services.monitor.history.interval_buffer import IntervalBuffer
from services.monitor.history.intervals import Disagreement, Disagreements, Interval, Sightings, interval_of
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting
from tests.services.monitor.inventory.seeing import FRONT, S, seen

BOX = Sighting(key=FRONT, name="box", count=1, score=0.5, first_ns=S, since_ns=S, last_ns=2 * S, model="m", worker="w")


class Seen:
    """What is in view, and what is to be written of it."""

    def __init__(self) -> None:
        self.buffer = IntervalBuffer()
        self.sightings = Sightings(self.buffer)

    def change(
        self, kind: ChangeKind, *, since_s: int = 1, last_s: int = 2, count: int = 1, closest_m: float | None = None
    ) -> None:
        of = replace(BOX, count=count, since_ns=since_s * S, last_ns=last_s * S)
        self.sightings.take([Change(kind, of, closest_m=closest_m)])

    def told(self) -> list[tuple[int, int, int, bool]]:
        """Return what is to be written as (count, since, until, open), and take it as written."""
        some = [each for each in self.buffer.pending(100) if isinstance(each, Interval)]
        self.buffer.written(some)
        return [(each.count, each.since_ns // S, each.until_ns // S, each.open) for each in some]


def test_an_interval_lasts_as_long_as_the_count() -> None:
    seen = Seen()
    seen.change(ChangeKind.APPEARED)
    assert seen.told() == [(1, 1, 2, True)]
    seen.change(ChangeKind.COUNTED, count=3, since_s=5, last_s=6, closest_m=2.5)
    (one, _) = seen.buffer.pending(2)
    assert isinstance(one, Interval)
    assert one.closest_m == 2.5
    assert seen.told() == [(1, 1, 5, False), (3, 5, 6, True)]
    seen.change(ChangeKind.VANISHED, count=0, since_s=9, last_s=8, closest_m=1.5)
    (three,) = seen.buffer.pending(2)
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
    seen.buffer.adopt([interval_of(BOX)])
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


STALE_S = TrustLimits().stale_ns // S


class Camera:
    """A camera of which two models count boxes, and what was entered in the buffer of it."""

    def __init__(self) -> None:
        self.inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0)))
        self.inventory.robot_presence("r1", alive=True)
        self.inventory.camera_presence(FRONT, alive=True)
        self.buffer = IntervalBuffer()
        self.disagreements = Disagreements(self.inventory, self.buffer)
        self._seq = 0

    def see(self, at_s: int, **counts: int) -> None:
        for model, count in counts.items():
            self._seq += 1
            self.inventory.see(seen(self._seq, {"box": count}, model=model), at_s * S)

    def noted(self, at_s: int) -> list[tuple[int, int, int, int, bool]]:
        """Return (ours, theirs, since, until, open)."""
        for _ in self.disagreements.note(at_s * S):
            pass
        some = [each for each in self.buffer.pending(100) if isinstance(each, Disagreement)]
        self.buffer.written(some)
        assert {(each.name, each.model, each.other_model) for each in some} <= {("box", "m", "n")}
        return [(of.count, of.other_count, of.since_ns // S, of.until_ns // S, of.open) for of in some]


def test_a_disagreement_lasts_until_they_agree() -> None:
    camera = Camera()
    camera.see(1, m=2, n=2)
    camera.see(2, m=2, n=2)
    assert camera.noted(2) == []
    camera.see(3, m=2, n=1)
    assert camera.noted(3) == [(2, 1, 3, 3, True)]
    assert camera.noted(4) == []
    camera.see(4, m=3, n=1)
    assert camera.noted(5) == [(2, 1, 3, 5, False), (3, 1, 5, 5, True)]
    camera.see(6, m=3, n=3)
    assert camera.noted(7) == [(3, 1, 5, 7, False)]
    assert camera.noted(8) == []


def test_it_is_not_known_of_a_camera_that_nobody_speaks_for() -> None:
    camera = Camera()
    camera.see(1, m=2, n=1)
    assert camera.noted(1) == [], "one list may be that which late subscribers get"
    camera.see(2, m=2, n=1)
    assert camera.noted(2) == [(2, 1, 2, 2, True)]
    assert camera.noted(3 + STALE_S) == [(2, 1, 2, 3 + STALE_S, False)]
    camera.see(10, m=2, n=1)
    assert camera.noted(10) == [(2, 1, 10, 10, True)]


def test_who_falls_silent_disagrees_no_more() -> None:
    camera = Camera()
    camera.see(1, m=2, n=1)
    camera.see(2, m=2, n=1)
    camera.noted(2)
    camera.see(9, m=2)
    assert camera.noted(9) == [(2, 1, 2, 9, False)]


def test_it_ends_where_a_new_model_takes_over() -> None:
    camera = Camera()
    for at_s in (1, 2):
        camera.see(at_s, m=2, n=1)
    assert camera.noted(2) == [(2, 1, 2, 2, True)]
    camera.see(3 + STALE_S, n=1)
    camera.inventory.tick((3 + STALE_S) * S)
    assert camera.inventory.disputed() == set()
    assert camera.noted(4 + STALE_S) == [(2, 1, 2, 4 + STALE_S, False)]


def test_of_three_models_it_is_the_one_that_counts_otherwise() -> None:
    camera = Camera()
    for at_s in (1, 2):
        camera.see(at_s, m=2, n=1, o=2)
    assert camera.noted(2) == [(2, 1, 2, 2, True)]
