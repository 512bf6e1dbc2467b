import msgspec

from schemas import worker_keys
from schemas.detections import ClassCount
from schemas.keys import CameraKey
from services.monitor.inventory.camera import MAX_MODELS, CameraView, nearest_of
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.sighting import Change, ChangeKind
from services.monitor.inventory.view import MAX_CLASSES
from tests.schemas.results import distances, known, unknown
from tests.services.monitor.inventory.seeing import FRONT, S, seen

SILENT_NS = 3 * S
LOST_NS = 60 * S


class Seeing:
    """A camera whose lists come one a second."""

    def __init__(self, debounce: Debounce | None = None) -> None:
        self.vocabularies: dict[tuple[str, str], set[str]] = {}
        self.camera = CameraView(FRONT, self.vocabularies)
        self.debounce = debounce or Debounce(2, 0, 2, 0)
        self.seq = 0

    def see(self, at_s: int, model: str = "m", /, **counts: int) -> list[tuple[str, str, int]]:
        return [
            (each.kind.value, each.sighting.name, each.sighting.count) for each in self.changes(at_s, model, counts)
        ]

    def changes(self, at_s: int, model: str, counts: dict[str, int]) -> list[Change]:
        self.seq += 1
        changes = self.camera.see(seen(self.seq, counts, model=model), at_s * S, self.debounce, SILENT_NS, LOST_NS)
        assert changes is not None
        return changes

    def opine(self, at_s: int, model: str = "new", /, **counts: int) -> bool:
        self.seq += 1
        return self.camera.opine(seen(self.seq, counts, model=model), at_s * S, self.debounce, SILENT_NS)


def test_a_class_appears_is_counted_and_vanishes() -> None:
    camera = Seeing()
    assert camera.see(1) == []
    assert camera.see(2, box=1) == []
    assert camera.see(3, box=2) == [("appeared", "box", 1)]
    assert camera.see(4, box=2) == [("counted", "box", 2)]
    assert camera.see(5) == []
    assert camera.see(6) == [("vanished", "box", 0)]
    (last,) = camera.camera.sightings()
    assert (last.count, last.first_ns, last.last_ns) == (0, 2 * S, 4 * S)


def test_a_flicker_leaves_nothing_behind() -> None:
    camera = Seeing()
    assert camera.see(1, box=1) == []
    assert camera.see(2) == []
    assert list(camera.camera.sightings()) == []
    assert camera.camera.primary
    assert camera.camera.primary.classes == {}


def test_what_was_there_from_the_first_list_on_nobody_saw_come() -> None:
    camera = Seeing()
    camera.see(1, box=1)
    (appeared,) = camera.changes(2, "m", {"box": 1, "pallet": 1})
    assert (appeared.kind, appeared.first_look) == (ChangeKind.APPEARED, True)
    (appeared,) = camera.changes(3, "m", {"box": 1, "pallet": 1})
    assert (appeared.kind, appeared.sighting.name, appeared.first_look) == (ChangeKind.APPEARED, "pallet", False)


def test_a_double_is_none() -> None:
    camera = CameraView(FRONT)
    once = seen(3, {"box": 1})
    assert camera.see(once, 1, Debounce(), SILENT_NS, LOST_NS) == []
    assert camera.see(once, 2, Debounce(), SILENT_NS, LOST_NS) is None
    assert camera.last_ns == 1


def test_one_model_speaks_until_it_is_silent_and_the_next_goes_on_with_its_sightings() -> None:
    camera = Seeing()
    camera.see(1, "a", box=1, pallet=1)
    camera.see(2, "a", box=1, pallet=1)
    assert camera.see(3, "b", box=1) == []
    assert camera.see(5, "b", box=1) == []
    assert camera.see(6, "b", box=1) == []
    assert camera.see(7, "b", box=1) == []
    assert camera.see(8, "b", box=1) == [("vanished", "pallet", 0)]
    assert [(each.name, each.count, each.first_ns, each.model) for each in camera.camera.sightings()] == [
        ("box", 1, 1 * S, "b"),
        ("pallet", 0, 1 * S, "b"),
    ]


def test_what_the_next_model_says_otherwise_is_so_since_the_last_word_of_the_one_before() -> None:
    camera = Seeing()
    for at_s in (1, 2):
        camera.see(at_s, "a", box=1)
        camera.see(at_s, "b", box=3, pallet=1)
    camera.see(3, "a", box=1)
    camera.see(5, "b", box=3, pallet=1)
    moved = {of.sighting.name: of for of in camera.changes(7, "b", {"box": 3, "pallet": 1})}
    box, pallet = moved["box"], moved["pallet"]
    assert (box.kind, box.sighting.since_ns, box.sighting.first_ns) == (ChangeKind.COUNTED, 3 * S, 1 * S)
    assert (pallet.kind, pallet.sighting.since_ns, pallet.first_look) == (ChangeKind.APPEARED, 3 * S, True)


def test_what_came_after_the_last_word_of_a_model_appears_however_often_the_next_one_counted_it_since() -> None:
    camera = Seeing()
    for at_s in (1, 2, 3):
        camera.see(at_s, "a")
        camera.see(at_s, "b")
    assert [camera.see(at_s, "b", box=count) for at_s, count in ((4, 1), (5, 1), (6, 2))] == [[]] * 3
    (appeared,) = camera.changes(7, "b", {"box": 2})
    assert (appeared.kind, appeared.sighting.count, appeared.first_look) == (ChangeKind.APPEARED, 2, False)
    assert appeared.sighting.first_ns == appeared.sighting.since_ns == 6 * S


def test_models_that_count_otherwise_disagree_about_what_both_know() -> None:
    camera = Seeing()
    for at_s in (1, 2):
        camera.see(at_s, "a", box=1, pallet=1)
        camera.see(at_s, "b", box=2, forklift=1)
    assert camera.camera.disagreements(0) == {"box": (1, 2)}
    assert camera.camera.disagreements(2 * S + 1) == {}


def test_a_second_opinion_disagrees_and_never_speaks() -> None:
    camera = Seeing()
    assert camera.opine(1, box=3)
    assert camera.opine(2, box=3)
    assert camera.camera.primary is None
    assert camera.camera.disagreements(0) == {}
    camera.see(3, "m", box=1)
    assert camera.see(4, "m", box=1) == [("appeared", "box", 1)]
    assert camera.opine(4, box=3)
    assert camera.camera.disagreements(0) == {"box": (1, 3)}
    for at_s in range(5, 20):
        assert camera.opine(at_s, box=3)
    assert [(each.count, each.model, each.last_ns) for each in camera.camera.sightings()] == [(1, "m", 4 * S)]
    assert camera.camera.last_ns == 4 * S


def test_what_a_worker_says_it_reports_may_be_missing_from_all_its_lists() -> None:
    camera = Seeing()
    for at_s in (1, 2):
        camera.see(at_s, "m", box=1, pallet=1, tree=1)
        assert camera.opine(at_s, forklift=2, shelf=1)
    assert camera.camera.disagreements(0) == {}
    camera.vocabularies["detector", "w"] = {"forklift", "box"}
    camera.vocabularies["opinion", "w"] = {"box", "pallet"}
    assert camera.camera.disagreements(0) == {"box": (1, 0), "pallet": (1, 0), "forklift": (0, 2)}


def test_a_second_opinion_of_a_model_of_the_same_name_is_another() -> None:
    camera = Seeing()
    for at_s in (1, 2):
        camera.see(at_s, "best.pt", box=1)
        assert camera.opine(at_s, "best.pt", box=2)
    assert camera.camera.disagreements(0) == {"box": (1, 2)}


def test_a_double_of_a_second_opinion_is_none() -> None:
    camera = Seeing()
    assert camera.opine(1, box=1)
    camera.seq = 0
    assert not camera.opine(2, box=2)


def test_a_second_opinion_settles_anew_after_a_gap() -> None:
    camera = Seeing()
    for at_s in (1, 2, 3, 4, 5, 6, 7):
        camera.see(at_s, "m", box=1)
        if at_s < 3:
            assert camera.opine(at_s, box=2)
    assert camera.camera.disagreements(3 * S) == {}
    assert camera.opine(8, box=1)
    assert camera.camera.disagreements(5 * S) == {}
    assert camera.opine(9, box=1)
    assert camera.camera.disagreements(5 * S) == {}
    assert camera.opine(10, box=2)
    assert camera.opine(11, box=2)
    assert camera.camera.disagreements(5 * S) == {"box": (1, 2)}


def test_second_opinions_are_bounded_and_the_newest_stay() -> None:
    camera = Seeing()
    for number in range(MAX_MODELS + 1):
        camera.opine(1 + number, f"m{number}", box=1)
    assert set(camera.camera.opinions) == {f"m{number}" for number in range(1, MAX_MODELS + 1)}


def test_models_are_bounded_and_the_one_that_speaks_stays() -> None:
    camera = Seeing()
    for number in range(MAX_MODELS + 1):
        camera.see(1, f"m{number}", box=1)
    assert len(camera.camera.views) == MAX_MODELS
    assert "m0" in camera.camera.views


def test_classes_are_bounded_and_those_in_view_stay() -> None:
    camera = Seeing(Debounce(1, 0, 1, 0))
    camera.see(1, **{f"c{number}": 1 for number in range(MAX_CLASSES)})
    assert camera.see(2, **{f"c{number}": 1 for number in range(MAX_CLASSES)}, late=1) == []
    camera.see(3, **{f"c{number}": 1 for number in range(1, MAX_CLASSES)})
    assert camera.see(4, **{f"c{number}": 1 for number in range(1, MAX_CLASSES)}, late=1) == [("appeared", "late", 1)]
    assert len(list(camera.camera.sightings())) == MAX_CLASSES


def test_distances_belong_to_what_is_in_view_and_grow_old() -> None:
    camera = Seeing(Debounce(1, 0, 1, 0))
    camera.see(1, box=2, pallet=1)
    near = distances(known("box", 4.0), known("box", 2.0), unknown("pallet"), seq=1)
    assert camera.camera.measure(near, 5)
    assert not camera.camera.measure(near, 6)
    assert [each.nearest_m for each in camera.camera.sightings(5)] == [2.125, None]
    assert [each.nearest_m for each in camera.camera.sightings(6)] == [None, None]
    camera.see(2)
    assert [each.nearest_m for each in camera.camera.sightings()] == [None, None]


def test_the_nearest_is_straight_where_that_is_known() -> None:
    measured = known("box", 2.0)
    assert nearest_of([measured, unknown("pallet")]) == {"box": 2.125}


def test_after_a_loss_what_is_in_view_is_seen_anew() -> None:
    camera = Seeing()
    camera.see(1, box=1)
    camera.see(2, box=1)
    (lost,) = camera.camera.lose()
    assert (lost.kind, lost.sighting.last_ns) == (ChangeKind.LOST, 2 * S)
    assert [each.count for each in camera.camera.sightings()] == [1]
    assert camera.see(200, box=1) == []
    (again,) = camera.changes(201, "m", {"box": 1})
    assert (again.kind, again.first_look, again.sighting.first_ns) == (ChangeKind.APPEARED, True, 200 * S)


def test_a_restored_sighting_goes_on() -> None:
    camera = Seeing()
    camera.see(1, box=2)
    camera.see(2, box=2)
    restored = Seeing()
    for sighting in camera.camera.sightings():
        restored.camera.restore(sighting)
    assert list(restored.camera.sightings()) == list(camera.camera.sightings())
    assert restored.see(10, "m", box=2) == []
    assert restored.see(11, "m") == []
    assert restored.see(12, "m") == [("vanished", "box", 0)]
    assert CameraView(CameraKey("r1", "rear")).last_ns == 0


def test_how_near_a_class_came_is_told_when_it_vanishes() -> None:
    camera = Seeing()
    camera.see(1, box=1)
    camera.see(2, box=1)
    camera.camera.measure(distances(known("box", 2.0)), 2 * S)
    camera.see(3)
    (vanished,) = camera.changes(4, "m", {})
    assert (vanished.kind, vanished.closest_m) == (ChangeKind.VANISHED, 2.125)
    camera.see(5, box=1)
    (appeared,) = camera.changes(6, "m", {"box": 1})
    assert (appeared.sighting.closest_m, appeared.closest_m) == (None, None)


def test_a_class_that_a_list_names_twice_is_seen_once() -> None:
    camera = Seeing()
    twice = msgspec.structs.replace(seen(1, {}), classes=[ClassCount("box", 1, 0.5), ClassCount("box", 7, 0.5)])
    assert camera.camera.see(twice, S, camera.debounce, SILENT_NS, LOST_NS) == []
    camera.seq = 1
    assert camera.see(2, box=1) == [("appeared", "box", 1)]


def test_models_disagree_only_once_what_each_has_in_view_would_count() -> None:
    camera = Seeing(Debounce(4, 0, 1, 0))
    camera.vocabularies[worker_keys.OPINION, "w"] = {"box"}
    for at_s in range(1, 5):
        camera.see(at_s, box=1)
    for at_s in range(5, 8):
        camera.see(at_s, box=1)
        camera.opine(at_s, box=1)
        assert camera.camera.disagreements(0) == {}
    camera.opine(8, box=1)
    assert camera.camera.disagreements(0) == {}
    for at_s in range(9, 13):
        camera.opine(at_s, box=2)
    assert camera.camera.disagreements(0) == {"box": (1, 2)}


def test_a_clock_that_is_set_back_neither_unsettles_a_camera_nor_keeps_one_from_settling() -> None:
    settled, not_yet = Seeing(Debounce(1, 5 * S, 1, 0)), Seeing(Debounce(1, 5 * S, 1, 0))
    for at_s in (3_600, 3_603, 3_606):
        settled.see(at_s)
    for at_s in (3_604, 3_605):
        not_yet.see(at_s)
    for each in (settled, not_yet):
        each.camera.set_back(10 * S)
        each.see(11)
    assert (settled.camera.settled, not_yet.camera.settled) == (True, False)
    not_yet.see(15)
    assert not_yet.camera.settled
