"""What `services.detector.model.Model` promises, held against the fake and the shipped model under each runtime."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pycocotools import mask as coco

from schemas.detections import Detection
from schemas.tuning import Tuning
from services.detector.fleet_model import FleetModel, LoadedModel
from services.detector.frame_counts import MALFORMED
from services.detector.model import DetectedObjects, Failed, Model, Outcome, Request, TuningError
from services.detector.runtime.loading import load
from services.detector.settings import DetectorSettings
from tests.schemas.pictures import compressed
from tests.services.detector.support.fakes import FakeModel
from tests.services.detector.support.requests import request
from tests.services.detector.support.views import near_view


@pytest.fixture(params=["fake", "fleet", "torch", "onnx", "openvino"], scope="module")
def made(request: pytest.FixtureRequest, model_folder: Path) -> Model:
    if request.param == "fake":
        return FakeModel()
    if request.param == "fleet":
        return FleetModel(LoadedModel("", "fake", FakeModel()))
    settings = DetectorSettings.model_validate({"runtime": request.param, "cache": model_folder / "cache"})
    return load(settings, model_folder / "ultralytics")


@pytest.fixture
async def model(made: Model) -> AsyncIterator[Model]:
    before = made.tuning
    yield made
    made.tune(before)


@pytest.fixture(scope="module")
def view() -> NDArray[np.uint8]:
    """Look at a forklift, boxes and a pallet, in BGR."""
    return near_view()


async def found(
    model: Model, image: NDArray[np.uint8], encoding: str = "bgr8", *, masks: bool = False
) -> list[Detection]:
    (outcome,) = await model.infer([request(image, encoding, masks=masks)])
    assert isinstance(outcome, DetectedObjects)
    return outcome.objects


def inside(found: Detection, height: int, width: int) -> bool:
    box = found.box
    return 0 <= box.x1 < box.x2 <= width and 0 <= box.y1 < box.y2 <= height


async def test_objects_are_named_scored_inside_the_image_and_best_first(model: Model, view: NDArray[np.uint8]) -> None:
    objects = await found(model, view)
    assert objects
    assert all(inside(each, *view.shape[:2]) and each.name for each in objects)
    scores = [each.score for each in objects]
    assert scores == sorted(scores, reverse=True)
    assert all(0 < score <= 1 for score in scores)


async def test_masks_only_when_asked_for_of_the_images_size_and_inside_their_boxes(
    model: Model, view: NDArray[np.uint8]
) -> None:
    assert all(each.mask is None for each in await found(model, view))
    for each in await found(model, view, masks=True):
        assert each.mask is not None
        assert each.mask.size == view.shape[:2]
        rows, columns = np.nonzero(coco.decode({"size": list(each.mask.size), "counts": each.mask.counts.encode()}))
        assert each.box.x1 <= columns.min()
        assert columns.max() < each.box.x2
        assert each.box.y1 <= rows.min()
        assert rows.max() < each.box.y2


@pytest.mark.parametrize("shape", [(1, 1, 3), (7, 5, 3), (480, 848, 3), (1080, 64, 3)])
async def test_any_size_of_image_will_do(model: Model, shape: tuple[int, int, int]) -> None:
    for each in await found(model, np.zeros(shape, np.uint8), masks=True):
        assert inside(each, *shape[:2])


async def test_colour_order_changes_nothing(model: Model, view: NDArray[np.uint8]) -> None:
    alpha = np.zeros((*view.shape[:2], 1), np.uint8)
    rgb = view[..., ::-1]
    as_others = {"rgb8": rgb, "bgra8": np.concatenate([view, alpha], 2), "rgba8": np.concatenate([rgb, alpha], 2)}
    expected = await found(model, view, masks=True)
    for encoding, pixels in as_others.items():
        assert await found(model, np.ascontiguousarray(pixels), encoding, masks=True) == expected, encoding


async def test_a_batch_is_answered_in_order_and_a_bad_image_fails_alone(model: Model, view: NDArray[np.uint8]) -> None:
    cut_off = compressed(
        b"\xff\xd8\xff\xc0\x00\x11\x08\x00\x30\x00\x40\x03", "rgb8", 192, kind="jpeg", height=48, width=64
    )
    small = np.zeros((48, 64, 3), np.uint8)
    batch = [request(view), Request(request(view).camera, cut_off, masks=False), request(small)]
    outcomes = await model.infer(batch)
    assert isinstance(outcomes[1], Failed)
    assert outcomes[1].reason == MALFORMED
    for outcome, alone in zip(outcomes[::2], [await found(model, view), await found(model, small)], strict=True):
        assert [each.name for each in _objects(outcome)] == [each.name for each in alone]
        assert [each.score for each in _objects(outcome)] == pytest.approx([each.score for each in alone], abs=0.02)


def _objects(outcome: Outcome) -> list[Detection]:
    assert isinstance(outcome, DetectedObjects)
    return outcome.objects


async def test_calls_end_in_the_order_in_which_they_began(model: Model, view: NDArray[np.uint8]) -> None:
    ended: list[int] = []

    async def one(number: int, image: NDArray[np.uint8]) -> None:
        await found(model, image, masks=True)
        ended.append(number)

    async with asyncio.TaskGroup() as group:
        for number in range(6):
            group.create_task(one(number, view if number % 2 else view[:8, :8]))
    assert ended == list(range(6))


async def test_it_says_what_time_went_where(model: Model, view: NDArray[np.uint8]) -> None:
    (outcome,) = await model.infer([request(view)])
    assert isinstance(outcome, DetectedObjects)
    assert outcome.spans["model"] > 0


async def test_every_class_has_a_number_of_its_own(model: Model, view: NDArray[np.uint8]) -> None:
    pairs = {(each.name, each.label) for each in await found(model, view)}
    assert len(pairs) == len({name for name, _ in pairs}) == len({label for _, label in pairs})
    assert model.name


async def test_tuning_leaves_what_it_does_not_name(model: Model) -> None:
    before = model.tuning
    model.tune(Tuning(max_detections=1, classes=["box"]))
    assert model.tuning == Tuning(confidence=before.confidence, iou=before.iou, max_detections=1, classes=["box"])


async def test_an_unknown_class_is_refused_and_changes_nothing(model: Model) -> None:
    before = model.tuning
    with pytest.raises(TuningError, match=r"no class is called 'unicorn'; the model knows .*box"):
        model.tune(Tuning(classes=["unicorn"]))
    assert model.tuning == before


async def test_the_classes_it_reports_are_those_it_is_tuned_to(model: Model, view: NDArray[np.uint8]) -> None:
    assert {each.name for each in await found(model, view)} <= set(model.classes)
    model.tune(Tuning(classes=["box"]))
    assert model.classes == ("box",)
