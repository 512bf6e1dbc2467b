"""Models that change between calls, and a canary that looks at the cameras of single robots."""

import asyncio
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from schemas.keys import CameraKey
from schemas.tuning import Tuning
from services.detector import fleet_model
from services.detector.fleet_model import FleetModel, LoadedModel
from services.detector.model import (
    NO_MASKS,
    NO_MASKS_OF_POSES,
    DetectedObjects,
    Failed,
    ModelError,
    Outcome,
    Request,
    TuningError,
)
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

    async def infer(self, batch: Sequence[Request]) -> Sequence[Outcome]:
        if self.closed:
            raise RuntimeError("cannot schedule new futures after shutdown")
        return await super().infer(batch)

    def tune(self, tuning: Tuning) -> None:
        if unknown := set(tuning.classes or ()) - set(self.classes):
            raise TuningError(f"no class is called {min(unknown)!r}")
        super().tune(tuning)


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
    old.broken = True
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
    old.remarks = (f"a has no masks: {NO_MASKS}", "another remark")
    without = "a has no masks: no masks are drawn, distances and objects are not published"
    assert model.remarks == ("c is refused", without, "another remark")
    old.remarks = (f"a has no masks: {NO_MASKS_OF_POSES}",)
    assert model.remarks[1] == "a has no masks: no masks are drawn, and objects are not published"
    assert msgspec.structs.asdict(model.tuning) == msgspec.structs.asdict(Tuning())


async def test_a_model_that_changes_as_a_call_begins_stays_open_for_it() -> None:
    old, new = ClosableModel(), ClosableModel()
    model = FleetModel(loaded(old, "a"))
    call = asyncio.create_task(names(model, "r1", "r2"))
    asyncio.get_running_loop().call_soon(model.change, loaded(new, "b"))
    assert await call == ["a", "a"]
    assert (old.closed, model.name) == (True, "b")


async def test_a_canary_that_fails_is_dropped_and_the_model_in_force_answers() -> None:
    failed: list[str] = []
    old, new = ClosableModel(), ClosableModel()
    model = FleetModel(loaded(old, "a"), fails=lambda model, error: failed.append(f"{model.label}: {error}"))
    model.change(model.in_force, loaded(new, "b"), ["r2"])
    assert await names(model, "r1", "r2") == ["a", "b"]
    new.broken = True
    assert await names(model, "r1", "r2") == ["a", "a"]
    assert (model.canary, new.closed, failed) == (None, True, ["b: it is broken"])


async def test_a_canary_that_hangs_is_dropped_and_the_model_in_force_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_model, "TRIAL_S", 0.05)
    failed: list[str] = []
    model = FleetModel(loaded(ClosableModel(), "a"), fails=lambda _, error: failed.append(str(error)))
    model.change(model.in_force, loaded(ClosableModel(at_once=False), "b"), ["r2"])
    assert await names(model, "r2") == ["a"]
    assert (model.canary, failed) == (None, ["b has not answered for 0.05 s"])


async def test_a_model_that_worked_is_kept_until_the_next_one_works_and_answers_if_that_fails() -> None:
    failed: list[str] = []
    old, bad, good = ClosableModel(), ClosableModel(), ClosableModel()
    model = FleetModel(loaded(old, "a"), fails=lambda model, _: failed.append(model.label))
    assert await names(model, "r1") == ["a"]
    bad.broken = True
    model.change(loaded(bad, "b"))
    assert (model.name, old.closed) == ("b", False)
    assert await names(model, "r1") == ["a"]
    assert (model.name, bad.closed, old.closed, failed) == ("a", True, False, ["b"])
    model.change(loaded(good, "c"))
    assert await names(model, "r1") == ["c"]
    assert old.closed
    good.broken = True
    with pytest.raises(ModelError):
        await names(model, "r1")
    assert failed == ["b"]


async def test_it_tells_of_models_that_work() -> None:
    worked: list[str] = []
    model = FleetModel(loaded(ClosableModel(), "a"), works=worked.append)
    await model.infer([asked("r1", FATAL)])
    assert not worked
    await model.infer([asked("r1")])
    assert worked == ["a" * 32]


def test_a_model_without_a_class_of_a_request_follows_the_rest_and_says_so_while_it_is_used() -> None:
    model = FleetModel(loaded(ClosableModel("box"), "a"))
    model.tune(Tuning(confidence=0.7, classes=["box"]))
    other = ClosableModel("tote")
    model.change(loaded(other, "b"))
    assert other.tuning == Tuning(confidence=0.7)
    for notes in ((), ("another note",)):
        model.notes = notes
        note = "b reports the configured classes, not those of a request: no class is called 'box'"
        assert model.remarks == (*notes, note)
    model.tune(Tuning(confidence=0.6, classes=["tote"]))
    model.change(loaded(ClosableModel("tote"), "c"))
    assert model.remarks == ("another note",)
