"""The model's parts on their own: index, boxes from edges, offsets, what overlaps, who is back."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.distances import REACHES
from services.worldmodel.classes import ASSUMED_RATE, MAX_CLASSES, MOST_BROUGHT, Classes
from services.worldmodel.events import BACK_NS, Gone
from services.worldmodel.fusion import fitted
from services.worldmodel.objects import CELL_M, Index, Objects
from services.worldmodel.offsets import ALONE_VIEWS_TO_TRUST, JUMPED, RIGHT, TRUST_VIEWS, Localisation, Offsets
from services.worldmodel.placement import UNITS
from services.worldmodel.solids import overlap, shifted

PLACES = st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=30)


@given(PLACES, st.tuples(st.floats(-50, 50), st.floats(-50, 50)))
def test_the_index_finds_all_that_is_near(places: list[tuple[float, float]], at: tuple[float, float]) -> None:
    index, points = Index(), np.array(places)
    index.put(np.arange(len(places)), points)
    numbers, rows = index.near(np.array([at]))
    near = np.flatnonzero(np.abs(points - at).max(axis=1) <= CELL_M)
    assert set(near.tolist()) <= set(rows.tolist())
    assert set(numbers.tolist()) <= {0}
    low, high = np.array([at]) - 3.0, np.array([at]) + 3.0
    _, within = index.within(low, high)
    assert set(np.flatnonzero(np.abs(points - at).max(axis=1) <= 3.0).tolist()) <= set(within.tolist())


def test_what_moved_is_found_where_it_is_and_what_went_nowhere() -> None:
    index, rows = Index(), np.array([0, 1])
    index.put(rows, np.array([[0.5, 0.5], [1.0, 1.0]]))
    index.put(rows[:1], np.array([[20.0, 0.0]]))
    assert index.near(np.array([[0.5, 0.5]]))[1].tolist() == [1]
    index.drop(1)
    assert index.near(np.array([[0.5, 0.5], [20.0, 0.0]]))[1].tolist() == [0]


def test_the_index_does_not_grow_with_the_places_asked_for() -> None:
    index = Index()
    index.put(np.array([0]), np.array([[0.5, 0.5]]))
    assert index.near(np.array([[0.5, 0.5]]))[1].tolist() == [0]
    before = len(pickle.dumps(index))
    assert index.near(np.array([[100.0 * step, 0.0] for step in range(1, 500)]))[1].tolist() == []
    assert len(pickle.dumps(index)) == before


def edges_of(x: float, y: float, length: float, width: float, yaw: float) -> np.ndarray:
    along = np.array([np.cos(yaw), np.sin(yaw)])
    across = np.array([-along[1], along[0]])
    found: np.ndarray = UNITS @ [x, y] + np.abs(UNITS @ along) * length / 2 + np.abs(UNITS @ across) * width / 2
    return found


@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.9, 1.4])
def test_a_box_is_what_its_edges_say(yaw: float) -> None:
    edges = edges_of(400.0, -200.0, 1.2, 0.8, yaw)[np.newaxis]
    found = fitted(edges, np.full((1, 12), 4e-4), np.array([[1.0, 1.0, 0.5]]), np.array([[400.2, -200.1]]))
    assert found.centre[0] == pytest.approx([400.0, -200.0], abs=0.02)
    assert found.size[0] == pytest.approx([1.2, 0.8], abs=0.06)
    assert np.cos(2 * (found.yaw[0] - yaw)) > 0.98


def test_what_is_not_seen_of_a_box_is_as_its_class_usually_is() -> None:
    edges = edges_of(0.0, 0.0, 1.2, 0.8, 0.0)
    variance = np.where(UNITS[:, 0] > -0.1, 4e-4, np.inf)
    found = fitted(edges[np.newaxis], variance[np.newaxis], np.array([[1.2, 0.8, 0.05]]), np.array([[0.1, 0.0]]))
    assert found.centre[0] == pytest.approx([0.0, 0.0], abs=0.08)
    assert found.covariance[0, 0, 0] > found.covariance[0, 1, 1]


def two(first: tuple[float, ...], second: tuple[float, ...]) -> Objects:
    objects = Objects.none(2)
    for row, (x, y, low, length, height) in enumerate((first, second)):
        objects.outline[row] = edges_of(x, y, length, 0.4, 0.0)
        objects.size[row], objects.low[row], objects.high[row] = (length, 0.4), low, low + height
    return objects


@pytest.mark.parametrize(
    ("second", "share"),
    [
        ((0.0, 0.0, 0.0, 0.4, 0.4), 1.0),
        ((0.5, 0.0, 0.0, 0.4, 0.4), 0.0),
        ((0.0, 0.0, 0.4, 0.4, 0.4), 0.0),
        ((0.2, 0.0, 0.0, 0.4, 0.4), 0.5),
        ((0.0, 0.0, 0.0, 1.2, 0.4), 1.0),
    ],
    ids=["same", "beside", "on top", "half", "within"],
)
def test_how_much_two_things_are_at_one_place(second: tuple[float, ...], share: float) -> None:
    objects = two((0.0, 0.0, 0.0, 0.4, 0.4), second)
    assert overlap(objects, np.array([0]), np.array([1]))[0] == pytest.approx(share, abs=0.02)


def test_growth_at_one_side_is_no_motion() -> None:
    before = edges_of(0.0, 0.0, 0.4, 0.4, 0.0)[np.newaxis]
    grown = edges_of(0.3, 0.0, 1.0, 0.4, 0.0)[np.newaxis]
    moved = edges_of(0.6, 0.0, 0.4, 0.4, 0.0)[np.newaxis]
    assert shifted(grown, before)[0] < 0.2
    assert shifted(moved, before)[0] == pytest.approx(0.6, abs=0.01)


def test_edges_that_were_not_measured_before_tell_no_motion() -> None:
    guessed = edges_of(0.0, 0.0, 0.4, 0.4, 0.0)[np.newaxis]
    moved = edges_of(0.6, 0.0, 0.4, 0.4, 0.0)[np.newaxis]
    known = np.where(np.arange(REACHES) < REACHES // 2, guessed, np.nan)
    assert shifted(moved, known)[0] == 0
    assert shifted(moved, guessed)[0] > 0.5


def test_an_offset_is_learned_and_forgotten_again() -> None:
    offsets = Offsets(Localisation(0.07, 0.02, 30.0))
    offsets.reserve(1)
    robots, away = np.zeros(20, np.intp), np.random.default_rng(1).uniform(-5, 5, (20, 2))
    one, moved = np.zeros(1, np.intp), np.tile([0.08, -0.05], (20, 1))
    covariance = np.tile([0.004, 0.0, 0.004], (20, 1))
    for step in range(20):
        offsets.predict(one, one, np.array([(step + 1) * 500_000_000]), np.zeros((1, 3)))
        left = moved + offsets.state[0, :2] + offsets.state[0, 2] * np.stack([-away[:, 1], away[:, 0]], axis=1)
        offsets.correct(robots, away, left, covariance)
    assert offsets.state[0] == pytest.approx([-0.08, 0.05, 0.0], abs=0.02)
    offsets.predict(one, one, np.array([300_000_000_000]), np.zeros((1, 3)))
    assert offsets.state[0] == pytest.approx([0.0, 0.0, 0.0], abs=0.001)


def test_a_robot_that_has_jumped_is_trusted_when_it_fits_and_late_where_nothing_is_known() -> None:
    for expected, found, views in ((5, 4, TRUST_VIEWS), (0, 0, ALONE_VIEWS_TO_TRUST)):
        offsets, one = Offsets(Localisation()), np.zeros(1, np.intp)
        offsets.reserve(1)
        for at_s, x in ((1, 0.0), (2, 30.0)):
            offsets.predict(one, one, np.array([at_s * 1_000_000_000]), np.array([[x, 0.0, 0.0]]))
        assert offsets.doubted[0] == JUMPED
        for _ in range(views - 1):
            offsets.judge(one, np.array([expected]), np.array([found]))
        assert offsets.doubted[0] == JUMPED
        offsets.judge(one, np.array([expected]), np.array([found]))
        assert offsets.doubted[0] == RIGHT


def test_who_is_back_is_known_for_a_while_and_near_its_place() -> None:
    gone = Gone()
    gone.add(7, 1, (3.9, 2.0, 0.2), 0)
    gone.add(8, 1, (9.0, 2.0, 0.2), 0)
    assert gone.take(2, (3.9, 2.0, 0.2), 1) is None
    assert gone.take(1, (4.4, 2.0, 0.2), 1) is None
    assert gone.take(1, (4.1, 2.1, 0.2), 1) == 7
    assert gone.take(1, (4.1, 2.1, 0.2), 1) is None
    assert gone.take(1, (9.0, 2.0, 0.2), BACK_NS + 1) is None


def test_classes_are_bounded() -> None:
    classes = Classes()
    numbers = [classes.number(f"c{number}") for number in range(MAX_CLASSES + 2)]
    assert numbers == [*range(MAX_CLASSES), -1, -1]
    assert classes.number("c3") == 3


def test_a_robot_brings_so_many_classes_and_those_without_objects_make_room() -> None:
    classes = Classes()
    assert [classes.number(f"a{number}", "r1") for number in range(MOST_BROUGHT + 1)] == [*range(MOST_BROUGHT), -1]
    assert classes.number("a3", "r1") == 3
    assert classes.number("box", "r2") == MOST_BROUGHT
    assert classes.is_short
    classes.release({0, 1, 2, 3, MOST_BROUGHT}, {2, 3})
    assert not classes.is_short
    more = [classes.number(f"b{number}", "r1") for number in range(MOST_BROUGHT)]
    assert (more.index(-1), classes.names[MOST_BROUGHT + 1]) == (MOST_BROUGHT - 2, "b0")  # two of the first are left
    assert classes.number("a9", "r1") == -1
    assert classes.number("a9", "r3") == 9
    classes.forget(["r1"])
    assert classes.number("c", "r1") >= 0


def test_a_class_without_objects_makes_room_for_another_one_that_knows_nothing_of_it() -> None:
    classes = Classes()
    for number in range(MAX_CLASSES):
        classes.number("forklift" if number == 5 else f"c{number}")
    everything = set(range(MAX_CLASSES))
    classes.learn(np.array([5, 5]), np.array([1.0, 1.0]), np.array([False, False]))
    assert classes.number("pallet", "r1") == -1
    classes.release(everything - {4, 5}, everything - {4, 5})
    assert classes.number("c4", "r1") == 4
    assert classes.number("pallet", "r1") == 5
    assert (classes.names[5], bool(classes.moves[5]), float(classes.sizes[5, 0])) == ("pallet", False, 1.2)
    assert classes.rate(np.array([5]), np.array([1.0]))[0] == pytest.approx(ASSUMED_RATE)
    assert classes.number("forklift", "r1") == -1
