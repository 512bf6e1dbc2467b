"""Robots whose detection models have other names for the same things."""

from dataclasses import replace
from functools import partial

import msgspec
import numpy as np
import pytest

from schemas.distances import CameraView
from services.worldmodel import model as model_module
from services.worldmodel.class_names import MOST_MODELS
from services.worldmodel.classes import MAX_CLASSES
from services.worldmodel.model import SiteModel
from services.worldmodel.offsets import RIGHT
from services.worldmodel.published_objects import PublishedObjects
from services.worldmodel.state import restored, saved
from tests.services.worldmodel.scene import (
    FOUR,
    KNOWN_S,
    NS,
    TWO,
    Camera,
    Thing,
    are_at,
    doubted,
    knowing,
    known,
    look_on,
    view,
    watch,
)


def with_model(seen: CameraView, model: str) -> CameraView:
    return msgspec.structs.replace(seen, model=model)


@pytest.mark.parametrize("robot", ["r1", "r2"])
def test_things_that_another_model_names_otherwise_stay_and_take_its_name_late(robot: str) -> None:
    model = knowing(FOUR)
    cartons = [replace(each, name="carton") for each in FOUR]
    numbers = model.objects.number[model.objects.told_to_others()].tolist()
    other = partial(with_model, model="other")
    assert look_on(model, cartons, Camera(robot=robot), 100, other) == []
    assert doubted(model, robot) == RIGHT
    assert model.left_out[robot, model_module.OTHER_NAME] == 100 * len(FOUR)
    assert [each.name for each in known(model)] == ["box"] * len(FOUR)
    rows = model.objects.told_to_others()
    assert (model.objects.last_ns[rows] == round((KNOWN_S + 49.5) * NS)).all()
    assert look_on(model, cartons, Camera(robot=robot), 40, other, start_s=KNOWN_S + 50) == []
    assert [each.name for each in known(model)] == ["carton"] * len(FOUR)
    assert model.objects.number[model.objects.told_to_others()].tolist() == numbers
    assert are_at(known(model), FOUR)


def test_things_that_another_model_names_otherwise_keep_their_names_while_one_robot_uses_these() -> None:
    model = knowing(FOUR)
    cartons = [replace(each, name="carton") for each in FOUR]
    for step in range(70):
        at_ns = round((KNOWN_S + step) * NS)
        second = with_model(view(cartons, Camera(robot="r2"), KNOWN_S + step), "other")
        assert model.take_all([(view(FOUR, Camera(), KNOWN_S + step), at_ns), (second, at_ns)]) == []
    assert [each.name for each in known(model)] == ["box"] * len(FOUR)


def test_another_model_that_names_nothing_does_not_miss_and_yet_looks_past() -> None:
    model = knowing(FOUR)
    other = partial(with_model, model="other")

    def blind(seen: CameraView) -> CameraView:
        return msgspec.structs.replace(other(seen), objects=[])

    before = model.objects.looks.copy()
    assert look_on(model, FOUR, Camera(), 40, blind) == []
    assert (model.objects.looks == before).all()
    assert doubted(model, "r1") == RIGHT
    look_on(model, FOUR, Camera(), 3, start_s=32.0)
    assert look_on(model, [], Camera(), 5, other, start_s=34.0) == ["gone"] * len(FOUR)


def test_after_a_restart_things_take_the_names_of_another_model_too() -> None:
    before = knowing(FOUR)
    model = SiteModel()
    restored("hall", saved("hall", "a", 0, before), model)
    cartons = [replace(each, name="carton") for each in FOUR]
    assert look_on(model, cartons, Camera(), 140, partial(with_model, model="other")) == []
    assert [each.name for each in known(model)] == ["carton"] * len(FOUR)
    assert [each.doubted for each in PublishedObjects("hall", "a", model).robots()] == [""]


def test_after_a_restart_a_class_that_is_rare_is_missed_as_before() -> None:
    things = [*TWO, Thing(5.2, 0.9, (0.4, 0.4, 0.9), name="drum")]
    model = SiteModel()
    restored("hall", saved("hall", "a", 0, knowing(things)), model)
    assert model.vocabulary.known() == {"m": ["box", "drum"]}
    (drum,) = np.flatnonzero(model.objects.cls == model.classes.names.index("drum"))
    before = model.objects.looks[drum]
    for step in range(20):
        at_s = KNOWN_S + step / 2
        model.take(view(things, Camera(), at_s, blind_to=[2]), round(at_s * NS))
    assert model.objects.looks[drum] > before + 5


def test_a_class_that_a_model_gave_by_mistake_is_none_of_its_own() -> None:
    model = knowing(FOUR)
    cartons = [replace(each, name="carton") for each in FOUR]
    other = partial(with_model, model="other")
    look_on(model, [*cartons[1:], FOUR[0]], Camera(robot="r2"), 1, other)
    look_on(model, cartons, Camera(robot="r2"), 140, other, start_s=KNOWN_S + 1)
    assert [each.name for each in known(model)] == ["carton"] * len(FOUR)
    assert doubted(model, "r2") == RIGHT


def test_a_class_that_has_another_ones_number_by_now_is_not_missed_by_a_model_that_gave_that_one() -> None:
    model = SiteModel()
    other = partial(with_model, model="other")
    carton = view([Thing(-4.0, 0.0, name="carton")], Camera(yaw=np.pi, robot="r2"), 0.5)
    model.take(other(carton), NS // 2)
    for number in range(1, MAX_CLASSES):
        model.classes.number(f"c{number}")
    model.classes.release(range(1, MAX_CLASSES), ())
    watch(model, FOUR, [Camera()], 1.0, 20)
    assert model.classes.names[0] == "box"
    rows = model.objects.told_to_others()
    before = model.objects.looks[rows].tolist()
    look_on(model, FOUR, Camera(), 10, lambda seen: msgspec.structs.replace(other(seen), objects=[]))
    assert model.objects.looks[rows].tolist() == before


def test_what_was_taken_for_a_class_that_is_rare_goes_when_its_model_gives_none_there_any_more() -> None:
    things = [*TWO, Thing(5.2, 0.9, (0.4, 0.4, 0.9), name="drum")]
    model = knowing(things)
    kinds = []
    for step in range(400):
        at_s = KNOWN_S + step / 2
        kinds += model.take(view(things, Camera(), at_s, blind_to=[2]), round(at_s * NS))
    assert [each.kind.value for each in kinds] == ["gone"]
    assert are_at(known(model), TWO)


def test_invented_models_are_bounded() -> None:
    model = knowing(TWO)
    seen = view(TWO, Camera(), KNOWN_S)
    for number in range(2 * MOST_MODELS):
        model.take(with_model(seen, f"m{number}"), round((KNOWN_S + number / 100) * NS))
    assert len(model.vocabulary._numbers) <= MOST_MODELS
    assert len(known(model)) == len(TWO)
