import asyncio
import logging
import threading
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.detections import Detection
from schemas.header import MAX_LABEL
from schemas.tuning import Tuning
from services.detector.frame_counts import FAILED
from services.detector.model import DetectedObjects, Failed, ModelError, Outcome, Request
from services.detector.runtime.criteria import Criteria
from services.detector.runtime.model_file import Task
from services.detector.runtime.pipeline import Pipeline
from services.detector.runtime.postprocess import Output
from services.detector.runtime.refinement.refiner import SIDE, CloseUps, Refined
from services.geometry.masks import decode
from tests.services.detector.runtime.engines import FACTS, NONSENSE, BrightEngine, output
from tests.services.detector.support.requests import request

DETECTION = replace(FACTS, task=Task())
BLANK = np.zeros((1, 32, 32, 3), np.uint8)


def grey(value: int, height: int = 48, width: int = 64) -> Request:
    return request(np.full((height, width, 3), value, np.uint8))


def score(outcome: Outcome) -> float:
    assert isinstance(outcome, DetectedObjects)
    return outcome.objects[0].score


def pipeline(engine: BrightEngine, *, max_batch: int = 8, reference: BrightEngine | None = None) -> Pipeline:
    return Pipeline(DETECTION, engine, Criteria(), blank=BLANK, max_batch=max_batch, reference=reference)


async def test_images_of_one_shape_are_computed_together_and_answered_in_order() -> None:
    engine = BrightEngine()
    outcomes = await pipeline(engine).infer([grey(255), grey(204, 32), grey(153)])
    assert engine.batches == [2, 1]
    assert [round(score(each), 2) for each in outcomes] == [1.0, 0.8, 0.6]


async def test_an_image_that_fails_in_a_batch_fails_alone() -> None:
    outcomes = await pipeline(BrightEngine()).infer([grey(255), grey(13), grey(204)])
    assert isinstance(outcomes[1], Failed)
    assert (outcomes[1].reason, str(outcomes[1].error)) == (FAILED, "unlucky")
    assert [round(score(each), 2) for each in outcomes[::2]] == [1.0, 0.8]


async def test_an_engine_that_computes_nothing_any_more_is_the_end() -> None:
    engine = BrightEngine()
    model = pipeline(engine)
    assert round(score((await model.infer([grey(255)]))[0]), 2) == 1.0
    engine.broken = True
    with pytest.raises(ModelError, match=r"fake\.pt works no longer: the device is lost"):
        await model.infer([grey(255), grey(204)])


async def test_an_engine_that_puts_out_nonsense_for_one_image_goes_on() -> None:
    engine = BrightEngine()
    model = pipeline(engine)
    outcomes = [*await model.infer([grey(NONSENSE)]), *await model.infer([grey(204)])]
    assert isinstance(outcomes[0], Failed)
    assert (outcomes[0].reason, str(outcomes[0].error)) == (FAILED, "a score that is not a number")
    assert round(score(outcomes[1]), 2) == 0.8


async def test_an_engine_that_puts_out_nothing_but_nonsense_is_the_end() -> None:
    with pytest.raises(ModelError, match=r"fake\.pt works no longer: a score that is not a number"):
        await pipeline(BrightEngine(score=float("nan"))).infer([grey(255)])


async def test_out_of_memory_makes_batches_smaller_from_then_on() -> None:
    engine = BrightEngine(memory=2)
    model = pipeline(engine)
    outcomes = await model.infer([grey(255), grey(204), grey(153), grey(255)])
    assert engine.batches == [4, 2, 2]
    assert [round(score(each), 2) for each in outcomes] == [1.0, 0.8, 0.6, 1.0]
    assert model.max_batch == 2


async def test_no_memory_for_a_single_image_is_the_end() -> None:
    with pytest.raises(ModelError, match=r"fake\.pt: no memory for even one image of 64x64"):
        await pipeline(BrightEngine(memory=0)).infer([grey(255, 64), grey(204, 64)])


async def test_the_first_image_is_checked_against_the_reference(caplog: pytest.LogCaptureFixture) -> None:
    reference = BrightEngine(score=0.9)
    model = pipeline(BrightEngine(), reference=reference)
    with caplog.at_level(logging.WARNING):
        await model.infer([grey(153)])
        await model.infer([grey(153)])
    assert reference.batches == [1]
    assert caplog.text.count("differs from torch") == 1
    assert "differs from torch" in model.remarks[-1]


async def test_rounding_is_no_difference(caplog: pytest.LogCaptureFixture) -> None:
    await pipeline(BrightEngine(), reference=BrightEngine(score=0.62)).infer([grey(153)])
    assert "differs from torch" not in caplog.text


async def test_a_model_without_masks_says_what_will_be_silent() -> None:
    model = pipeline(BrightEngine())
    assert not model.segments
    assert "overlay/segmentation, distances and objects are not published" in model.remarks[0]
    (outcome,) = await model.infer([replace(grey(255), masks=True)])
    assert isinstance(outcome, DetectedObjects)
    assert [each.mask for each in outcome.objects] == [None]


def test_a_name_is_no_longer_than_messages_carry() -> None:
    assert len(Pipeline(replace(FACTS, name="x" * 300), BrightEngine(), Criteria(), blank=BLANK).name) == MAX_LABEL


async def test_tuning_counts_from_the_next_image_on() -> None:
    model = pipeline(BrightEngine())
    model.tune(Tuning(confidence=0.7))
    assert [len(_objects(each)) for each in await model.infer([grey(153), grey(204)])] == [0, 1]
    model.tune(Tuning(classes=["pallet"]))
    assert [len(_objects(each)) for each in await model.infer([grey(204)])] == [0]


def _objects(outcome: Outcome) -> list[Detection]:
    assert isinstance(outcome, DetectedObjects)
    return outcome.objects


async def test_a_cancelled_caller_lets_nobody_overtake() -> None:
    engine, ended = BrightEngine(), list[int]()
    engine.may_run.clear()
    model = pipeline(engine)

    async def look(number: int, batch: list[Request]) -> None:
        await model.infer(batch)
        ended.append(number)

    async with asyncio.TaskGroup() as group:
        group.create_task(look(0, [grey(255)]))
        await asyncio.sleep(0)
        cancelled = group.create_task(look(1, []))
        await asyncio.sleep(0)
        group.create_task(look(2, []))
        await asyncio.sleep(0.05)
        cancelled.cancel()
        await asyncio.sleep(0.05)
        engine.may_run.set()
    assert ended == [0, 2]


async def test_an_image_is_answered_whatever_becomes_of_its_check(caplog: pytest.LogCaptureFixture) -> None:
    model = pipeline(BrightEngine(), reference=BrightEngine(memory=0))
    (outcome,) = await model.infer([grey(204)])
    assert round(score(outcome), 2) == 0.8
    assert "cannot be checked against torch: the device is full" in caplog.text


async def test_cancelled_callers_do_not_hold_up_those_after_them() -> None:
    model = pipeline(BrightEngine())
    cancelled = asyncio.create_task(model.infer([grey(255)]))
    await asyncio.sleep(0)
    cancelled.cancel()
    (outcome,) = await model.infer([grey(204)])
    assert round(score(outcome), 2) == 0.8


class MaskEngine:
    """Finds one box in the middle of each image, with a mask that fills it."""

    def run(self, images: NDArray[np.uint8]) -> list[Output]:
        """See `Engine.run`."""
        height, width = images.shape[1:3]
        ones = np.ones((1, height // 4, width // 4), np.float32)
        return [output([(width / 2, height / 2, 16, 16)], [(0.9, 0)], ones, [[1]]) for _ in images]


class LeftRefiner:
    """Finds that only the left half of each close-up is the object, if it is not broken."""

    def __init__(self, error: Exception | None = None, quality: float = 1.0) -> None:
        self.shown: list[CloseUps] = []
        self.threads: set[str] = set()
        self._error = error
        self._quality = quality

    def run(self, seen: CloseUps) -> Refined:
        """See `Refiner.run`."""
        self.shown.append(seen)
        self.threads.add(threading.current_thread().name)
        if self._error is not None:
            raise self._error
        odds = np.full((len(seen.labels), SIDE, SIDE), -1, np.float32)
        odds[:, :, : SIDE // 2] = 1
        return Refined(odds, np.full(len(odds), self._quality, np.float32))


def refining(refiner: LeftRefiner) -> Pipeline:
    return Pipeline(FACTS, MaskEngine(), Criteria(), blank=BLANK, refiner=refiner)


async def test_masks_are_refined_in_the_colours_of_the_image() -> None:
    refiner = LeftRefiner()
    pixels = np.zeros((64, 64, 3), np.uint8)
    pixels[..., 0] = 200  # blue
    (outcome,) = await refining(refiner).infer([request(pixels, masks=True)])
    (found,) = _objects(outcome)
    assert found.mask is not None
    window = decode(found.mask)
    assert (window.left, window.top, window.pixels.shape) == (20, 20, (24, 12))
    assert window.pixels.all()
    assert refiner.shown[0].pixels[0, 0, 0, :3].tolist() == [0, 0, 200]


async def test_nothing_is_refined_where_nobody_wants_masks() -> None:
    refiner = LeftRefiner()
    (outcome,) = await refining(refiner).infer([grey(100, 64)])
    assert len(_objects(outcome)) == 1
    assert not refiner.shown


async def test_a_refiner_takes_turns_with_the_engine_on_its_thread() -> None:
    refiner = LeftRefiner()
    model = refining(refiner)
    await asyncio.gather(*(model.infer([replace(grey(100, 64), masks=True)]) for _ in range(4)))
    assert len(refiner.shown) == 4
    assert len(refiner.threads) == 1
    assert refiner.threads.pop().startswith("model")


@pytest.mark.parametrize(
    ("refiner", "why"),
    [
        (LeftRefiner(RuntimeError("no good\nat all")), "no good"),
        (LeftRefiner(RuntimeError("CUDA out of memory")), "CUDA out of memory"),
        (LeftRefiner(quality=float("nan")), "what is not a number"),
    ],
)
async def test_masks_that_cannot_be_refined_stay_coarse_which_is_said_once(refiner: LeftRefiner, why: str) -> None:
    model, coarse = refining(refiner), Pipeline(FACTS, MaskEngine(), Criteria(), blank=BLANK)
    asked = replace(grey(100, 64), masks=True)
    for _ in range(2):
        (outcome,) = await model.infer([asked])
        (expected,) = await coarse.infer([asked])
        assert _objects(outcome) == _objects(expected)
    assert len(refiner.shown) == 2
    assert model.remarks == (f"{FACTS.name} leaves masks coarse where refining them fails: {why}",)
