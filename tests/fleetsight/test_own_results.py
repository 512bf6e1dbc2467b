"""Results of one's own, over real sessions."""

import asyncio

import msgspec
import pytest

import fleetsight
from fleetsight import Box
from schemas.detections import Detections, class_list
from tests.contract.waiting import next_of
from tests.fleetsight.stand_in import FOUND
from tests.fleetsight.test_own_model import CRATE, two


async def test_results_of_ones_own_are_published_while_they_are_wanted() -> None:
    async with two() as (_, own, other), own.results("r1", "front") as results:
        results.publish(FOUND)  # to nobody
        coming = asyncio.create_task(next_of(aiter(other.detections())))
        lists = asyncio.create_task(next_of(aiter(other.class_lists())))
        await results.until_wanted()
        while not (coming.done() and lists.done()):
            results.publish(FOUND)
            await asyncio.sleep(0.02)
        assert await coming == FOUND
        assert await lists == class_list(FOUND)
        await results.until_unwanted()
        assert not results.wanted


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"header": msgspec.structs.replace(FOUND.header, camera="rear")}, "header says r1/rear"),
        ({"objects": [msgspec.structs.replace(CRATE, score=2.0)]}, "Expected `float` <= 1.0"),
        ({"objects": [msgspec.structs.replace(CRATE, box=Box(-1, 0, 2, 2))]}, "Expected `float` >= 0"),
    ],
)
async def test_results_that_nobody_could_read_are_refused(change: dict[str, object], said: str) -> None:
    found: Detections = msgspec.structs.replace(FOUND, **change)
    async with two() as (_, own, other), own.results("r1", "front") as results:
        wanting = asyncio.create_task(next_of(aiter(other.detections())))
        await results.until_wanted()
        with pytest.raises(fleetsight.MessageError, match=f"results of r1/front: .*{said}"):
            results.publish(found)
        wanting.cancel()
        await asyncio.wait([wanting])
