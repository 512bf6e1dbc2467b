"""Robots that bring more new objects than there are: they pay for it themselves, and others are taken in."""

from collections.abc import Sequence

import msgspec
import numpy as np

from schemas.distances import CameraView, ViewedObject
from services.worldmodel.classes import MOST_BROUGHT
from services.worldmodel.model import SiteModel
from services.worldmodel.object_lifecycle import CROWDED, FLOOD, TOO_MANY, Rules
from services.worldmodel.objects import Unconfirmed
from services.worldmodel.placement import TOO_FAR, TOO_MANY_CLASSES, TOO_MANY_SEEN
from tests.services.worldmodel.scene import NS, Camera, Thing, known, view, watch

BOX = Thing(4.0, 0.0)
FLOODING = Camera(100.0, 0.0, robot="r1")
"""Far away from the others."""


def ghosts(count: int, x: float, y: float, reach: float, rng: np.random.Generator) -> list[ViewedObject]:
    """Return objects at random places around one, of a class that nobody else sees."""
    (box,) = view([BOX], Camera(), 1.0).objects
    places = rng.uniform(-1.0, 1.0, (count, 3)) * (reach, reach, 4.0) + np.array([x, y, 4.0])
    return [
        msgspec.structs.replace(
            box, name="drum", index=index, at=(x, y, z), reach_mm=[40] * 12, low_m=z - 0.03, high_m=z + 0.03
        )
        for index, (x, y, z) in enumerate(places.tolist())
    ]


def flood(camera: Camera, at_s: float, seen: Sequence[ViewedObject]) -> tuple[CameraView, int]:
    return view([], camera, at_s, extra=seen), round(at_s * NS)


def test_a_robot_that_fills_the_site_makes_room_for_others_and_is_named_for_it() -> None:
    model, rng = SiteModel(Rules(most_objects=1_500)), np.random.default_rng(4)
    for step in range(30):
        model.take(*flood(FLOODING, 1.0 + step / 10, ghosts(100, 100.0, 0.0, 20.0, rng)))
    assert len(model.objects.known()) == 1_500
    assert model.left_out["r1", TOO_MANY] > 0
    assert model.left_out["r1", FLOOD] == 0
    assert watch(model, [BOX, Thing(4.0, 1.2)], [Camera(robot="r2")], 4.0, 4) == ["appeared"] * 2
    assert [(each.x < 10.0, each.name) for each in known(model)] == [(True, "box")] * 2
    assert model.left_out["r1", FLOOD] == 2
    assert {robot for robot, _ in model.left_out} == {"r1"}
    assert len(model.objects.known()) == 1_500


def test_a_robot_has_so_many_unconfirmed_objects_and_a_confirmed_one_is_none_of_them() -> None:
    model, rng = SiteModel(Rules(most_unconfirmed=50)), np.random.default_rng(5)
    watch(model, [BOX], [Camera(robot="r1")], 1.0, 4)
    for step in range(5):
        model.take(*flood(Camera(yaw=np.pi), 4.0 + step / 10, ghosts(40, 0.0, 0.0, 20.0, rng)))
    assert (~model.objects.confirmed[model.objects.known()]).sum() == 50
    assert model.left_out["r1", FLOOD] > 0
    model.take(view([], Camera(yaw=np.pi), 90.0), 90 * NS)
    assert len(model.objects.known()) == 1
    model.take(*flood(Camera(yaw=np.pi), 91.0, ghosts(40, 0.0, 0.0, 20.0, rng)))
    assert len(model.objects.known()) == 41


def test_one_place_has_so_many_unconfirmed_objects_and_others_still_bring_theirs() -> None:
    rules, rng = Rules(), np.random.default_rng(6)
    model = SiteModel(rules)
    for step in range(20):
        model.take(*flood(Camera(robot="r1"), 1.0 + step / 10, ghosts(100, 4.5, 0.5, 0.99, rng)))
    unconfirmed = ~model.objects.confirmed[model.objects.known()]
    assert rules.most_at_place <= unconfirmed.sum() <= 9 * rules.most_at_place  # their boxes are beside where seen
    assert model.left_out["r1", CROWDED] > 0
    assert "appeared" in watch(model, [Thing(4.5, 0.5)], [Camera(robot="r2")], 4.0, 4)
    assert "box" in {each.name for each in known(model)}
    assert {robot for robot, _ in model.left_out} == {"r1"}


def test_of_a_view_so_many_sightings_count() -> None:
    model, rng = SiteModel(), np.random.default_rng(7)
    model.take(*flood(Camera(), 1.0, ghosts(1_000, 0.0, 0.0, 20.0, rng)))
    assert model.sightings == 300
    assert model.left_out["r1", TOO_MANY_SEEN] == 700


def test_nonsense_names_leave_room_for_classes_and_go_with_their_objects() -> None:
    model, rng = SiteModel(), np.random.default_rng(8)
    for step in range(10):
        seen = [
            msgspec.structs.replace(each, name=f"{step}-{each.index}") for each in ghosts(50, 100.0, 0.0, 20.0, rng)
        ]
        model.take(*flood(FLOODING, 1.0 + step, seen))
    assert model.left_out["r1", TOO_MANY_CLASSES] == 10 * 50 - MOST_BROUGHT
    assert model.left_out["r1", TOO_FAR] == 0
    assert watch(model, [BOX, Thing(4.0, 1.2, name="crate")], [Camera(robot="r2")], 12.0, 4) == ["appeared"] * 2
    model.take(view([], Camera(robot="r2"), 90.0), 90 * NS)
    assert len(model.objects.known()) == 2
    seen = [msgspec.structs.replace(each, name=f"x{each.index}") for each in ghosts(50, 100.0, 0.0, 20.0, rng)]
    model.take(*flood(FLOODING, 91.0, seen))
    assert len(model.objects.known()) == 52
    assert {each.name for each in known(model)} == {"box", "crate"}


def test_what_makes_room_while_it_is_seen_is_gone_for_good() -> None:
    model = SiteModel(Rules(most_objects=6))
    things = [Thing(3.0, 0.5 * number - 1.0) for number in range(6)]
    views = [(view(things, Camera(robot="r1"), 1.0), NS)]
    model.take_all(views)
    first = Camera(20.0, 0.0, robot="r2")
    model.take_all([(view(things, Camera(robot="r1"), 1.5), NS), (view([Thing(23.0, 0.0)], first, 1.5), NS)])
    rows = model.objects.known()
    assert len(rows) == 6
    assert sorted(model.index._cell) == rows.tolist()
    assert model.left_out == {("r1", FLOOD): 1}


def test_the_robot_with_most_makes_room_and_no_two_of_them_in_turns() -> None:
    rows = Unconfirmed()
    for row, robot in enumerate(["a", "b", "b", "b", "a", "c"]):
        rows.add(row, robot, (0, row % 2))
    assert (rows.instead("c"), rows.instead("a"), rows.instead("b")) == (1, None, None)
    assert (rows.instead_at((0, 1), "a"), rows.instead_at((0, 0), "a"), rows.instead_at((1, 1), "a")) == (1, None, None)
    rows.drop(1)
    rows.drop(1)
    rows.forget(["b", "nobody"])
    assert (rows.count("b"), rows.count(""), rows.count_at((0, 1))) == (0, 2, 2)
    assert rows.instead("new") == 0
    for row in (0, 2, 3, 4, 5):
        rows.drop(row)
    assert rows.instead("new") is None
    assert [len(getattr(rows, name)) for name in ("_of", "_rows", "_places", "_by_count")] == [0] * 4
