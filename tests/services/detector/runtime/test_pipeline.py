import asyncio
import logging
from dataclasses import replace

import numpy as np
import pytest

from schemas.detections import Detection
from schemas.header import MAX_LABEL
from schemas.tuning import Tuning
from services.detector.account import FAILED
from services.detector.model import Failed, Found, ModelError, Outcome, Request
from services.detector.runtime.criteria import Criteria
from services.detector.runtime.pipeline import Pipeline
from tests.services.detector.requests import request
from tests.services.detector.runtime.engines import FACTS, BrightEngine

DETECTION = replace(FACTS, segments=False)
BLANK = np.zeros((1, 32, 32, 3), np.uint8)


def grey(value: int, height: int = 48, width: int = 64) -> Request:
    return request(np.full((height, width, 3), value, np.uint8))


def score(outcome: Outcome) -> float:
    assert isinstance(outcome, Found)
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
    assert "overlay/segmentation, distances and objects are silent" in model.remarks[0]
    (outcome,) = await model.infer([replace(grey(255), masks=True)])
    assert isinstance(outcome, Found)
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
    assert isinstance(outcome, Found)
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
