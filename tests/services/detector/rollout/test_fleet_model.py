"""Models that change between calls, and a canary that looks at the cameras of single robots."""

import asyncio

import msgspec
import numpy as np
import pytest

from schemas.keys import CameraKey
from schemas.tuning import Tuning
from services.detector.fleet_model import FleetModel, LoadedModel
from services.detector.model import SILENT, DetectedObjects, Failed, ModelError, Request
from tests.services.detector.support.requests import frame_of
from tests.services.detector.support.told_model import FATAL, ToldModel
from tests.waiting import until


class ClosableModel(ToldModel):
    """Knows whether it was closed, and which classes it has."""

    def __init__(self, *classes: str, max_batch: int = 4, at_once: bool = True) -> None:
        super().__init__(max_batch, at_once=at_once)
        self.classes = classes
        self.closed = False

    def close(self) -> None:
        self.closed = True


def loaded(model: ClosableModel, label: str) -> LoadedModel:
    return LoadedModel(label * 32, label, model)


def asked(robot: str, seq: int = 0) -> Request:
    return Request(CameraKey(robot, "front"), frame_of(np.zeros((2, 2, 3), np.uint8), seq=seq), masks=False)


async def names(model: FleetModel, *robots: str) -> list[str]:
    """Return which model looked at an image of each robot, in one batch."""
    outcomes = await model.infer([asked(robot) for robot in robots])
    return [outcome.model for outcome in outcomes if isinstance(outcome, DetectedObjects)]


async def test_objects_say_which_model_found_them() -> None:
    found = (await FleetModel(loaded(ClosableModel(), "a")).infer([asked("r1")]))[0]
    assert isinstance(found, DetectedObjects)
    assert found.detections(asked("r1").frame, model="of the worker", worker="w").model == "a"


async def test_a_batch_is_split_by_robot_and_stays_in_order() -> None:
    old, new = ClosableModel(), ClosableModel()
    model = FleetModel(loaded(old, "a"))
    model.change(model.in_force, loaded(new, "b"), ["r2", "r3"])
    assert await names(model, "r1", "r2", "r1", "r3") == ["a", "b", "a", "b"]
    assert [[each.camera.robot for each in call] for call in (*old.calls, *new.calls)] == [["r1", "r1"], ["r2", "r3"]]
    model.change(model.in_force)
    assert await names(model, "r1", "r2") == ["a", "a"]


async def test_a_bad_image_fails_alone_and_a_model_that_works_no_longer_is_an_error() -> None:
    old, new = ClosableModel(), ClosableModel()
    model = FleetModel(loaded(old, "a"))
    model.change(model.in_force, loaded(new, "b"), ["r2"])
    failed, found = await model.infer([asked("r1", FATAL), asked("r2")])
    assert isinstance(failed, Failed)
    assert isinstance(found, DetectedObjects)
    new.broken = True
    with pytest.raises(ModelError, match="it is broken"):
        await model.infer([asked("r1"), asked("r2")])


async def test_a_call_ends_with_the_model_that_it_began_with_and_that_is_closed_then() -> None:
    old, new = ClosableModel(at_once=False), ClosableModel()
    model = FleetModel(loaded(old, "a"))
    call = asyncio.create_task(names(model, "r1"))
    await until(lambda: old.answers)
    model.change(loaded(new, "b"))
    assert (model.name, await names(model, "r1")) == ("b", ["b"])
    assert not old.closed
    old.answers[0].set()
    assert await call == ["a"]
    assert old.closed
    assert not new.closed


async def test_a_canary_that_is_put_in_force_goes_on_and_the_old_one_is_closed() -> None:
    old, new = ClosableModel(), ClosableModel()
    model = FleetModel(loaded(old, "a"))
    canary = loaded(new, "b")
    model.change(model.in_force, canary, ["r1"])
    model.change(canary)
    assert await names(model, "r1", "r2") == ["b", "b"]
    assert (old.closed, new.closed) == (True, False)
    model.close()
    assert new.closed


async def test_settings_of_a_request_hold_for_the_models_that_come_later() -> None:
    model = FleetModel(loaded(ClosableModel(), "a"))
    canary, later = ClosableModel(), ClosableModel()
    model.change(model.in_force, loaded(canary, "b"), ["r1"])
    tuning = Tuning(confidence=0.7)
    model.tune(tuning)
    assert canary.tuning == model.tuning == tuning
    model.change(loaded(later, "c"))
    assert later.tuning == tuning


def test_it_says_of_both_models_what_there_is_to_say() -> None:
    old = ClosableModel("box", "pallet")
    model = FleetModel(loaded(old, "a"))
    model.change(model.in_force, loaded(ClosableModel("tote", "box", max_batch=2), "b"), ["r1"])
    model.notes = ("c is refused",)
    assert (model.classes, model.max_batch, model.remarks) == (("box", "pallet", "tote"), 2, ("c is refused",))
    old.remarks = (f"a has no masks: {SILENT}", "another remark")
    without = "a has no masks: no masks are drawn, distances and objects are silent"
    assert model.remarks == ("c is refused", without, "another remark")
    assert msgspec.structs.asdict(model.tuning) == msgspec.structs.asdict(Tuning())
