"""Hand-made warehouses and what was found in them."""

import pytest

from benchmarks.worldmodel.recording import LEAST_SHARE, NOTHING, RecordedImage, TrueObject, VisibleObject
from benchmarks.worldmodel.scoring import (
    LEAST_IMAGES,
    LEAST_VISIBILITY,
    FoundObject,
    IdentityScore,
    InventoryScore,
    asked_for,
    matched,
)
from schemas.detections import Detections
from tests.schemas.frames import header


def true(instance: int, x: float = 0.0, y: float = 0.0, z: float = 0.5, name: str = "box") -> TrueObject:
    return TrueObject(instance=instance, name=name, centre=(x, y, z), size=(0.4, 0.4, 0.4))


def found(x: float = 0.0, y: float = 0.0, z: float = 0.5, name: str = "box", known_as: str = "a") -> FoundObject:
    return FoundObject(known_as, name, (x, y, z))


def image(*visible: VisibleObject, shown: tuple[int, ...] = ()) -> RecordedImage:
    seen = Detections(header=header(), height=4, width=4, objects=[], model="", worker="w")
    return RecordedImage(detections=seen, depth_png=b"", pose=[], visible=[*visible], shown=[*shown])


def score(trues: list[TrueObject], asked: set[int], *finds: FoundObject) -> InventoryScore:
    made = InventoryScore()
    made.add(trues, asked, finds)
    return made


def test_an_object_is_asked_for_when_it_was_seen_well_often_enough() -> None:
    well = VisibleObject(1, LEAST_SHARE, LEAST_VISIBILITY)
    badly = VisibleObject(2, LEAST_SHARE, LEAST_VISIBILITY - 0.01), VisibleObject(3, LEAST_SHARE * 0.9, 1.0)
    images = [image(well, *badly)] * LEAST_IMAGES
    assert asked_for(images) == {1}
    assert asked_for(images[1:]) == set()


def test_a_right_inventory_is_perfect() -> None:
    made = score([true(1), true(2, x=2)], {1, 2}, found(), found(x=2.1))
    summary = made.summary()
    assert (summary["inventory_f1"], summary["duplicates"], summary["count_error"]) == (1.0, 0.0, {"box": 0.0})
    assert summary["position_error_p95_m"] == pytest.approx(0.095, abs=0.001)
    assert made.exact["box"] == 1


def test_missed_wrong_and_double_objects_are_told_apart() -> None:
    made = score([true(1), true(2, x=5)], {1, 2}, found(), found(x=0.2), found(x=20))
    assert (made.asked["box"], made.matched["box"], made.found["box"]) == (2, 1, 3)
    assert (made.wrong["box"], made.doubles["box"]) == (2, 1)
    assert made.f1 == pytest.approx(2 / 5)
    assert made.exact["box"] == 0


def test_an_object_that_nobody_asks_for_counts_neither_way() -> None:
    assert score([true(1), true(2, x=5)], {1}, found(), found(x=5)).f1 == 1.0
    assert score([true(1), true(2, x=5)], {1}, found()).f1 == 1.0


def test_another_class_at_the_place_is_wrong() -> None:
    made = score([true(1)], {1}, found(name="pallet"))
    assert (made.matched.total(), made.wrong["pallet"], made.asked["box"]) == (0, 1, 1)


def test_heights_count_where_they_are_known() -> None:
    stacked = [true(1, z=0.2), true(2, z=1.5)]
    assert len(matched([found(z=0.2), found(z=1.5)], stacked)) == 2
    assert len(matched([found(z=0.2), found(z=0.3)], stacked)) == 1
    flat = FoundObject("a", "box", (0.0, 0.0))
    assert len(matched([flat, flat], stacked)) == 2


def test_as_many_pairs_as_can_be_are_made() -> None:
    pairs = matched([found(x=0.4), found(x=-0.1)], [true(1), true(2, x=0.8)])
    assert {(row, column) for row, column, _ in pairs} == {(0, 1), (1, 0)}


def test_a_forklift_may_be_farther_from_its_centre() -> None:
    assert matched([found(x=0.9, name="forklift")], [true(1, name="forklift")])
    assert not matched([found(x=0.9)], [true(1)])


def purity(*steps: tuple[dict[int, float], dict[str, float]]) -> float | None:
    """Return the purity of steps: where true objects were, shown in an image, and where ids were."""
    made = IdentityScore()
    for places, ids in steps:
        trues = {instance: true(instance, x=x) for instance, x in places.items()}
        made.add(image(shown=(*places, NOTHING)), trues, [found(x=x, known_as=name) for name, x in ids.items()])
    return made.purity


def test_ids_that_stay_are_pure() -> None:
    assert purity(({1: 0, 2: 5}, {"a": 0, "b": 5}), ({1: 0, 2: 5}, {"a": 0.1, "b": 5.1})) == 1.0


def test_an_object_that_goes_by_two_ids_in_turn_is_half_pure() -> None:
    assert purity(({1: 0}, {"a": 0}), ({1: 0}, {"b": 0})) == 0.5


def test_an_id_that_two_objects_share_is_one_objects_alone() -> None:
    assert purity(({1: 0}, {"a": 0}), ({1: 0}, {"a": 0}), ({2: 5}, {"a": 5})) == pytest.approx(2 / 3, abs=0.001)


def test_what_is_not_shown_or_not_known_says_nothing() -> None:
    assert purity(({}, {"a": 0})) is None
    assert purity(({1: 0}, {})) is None
