"""Results of one's own, over real sessions."""

import asyncio

import msgspec
import numpy as np
import pytest

import fleetsight
from fleetsight import Box, Mask
from schemas.detections import Detections, class_list
from tests.fleetsight.stand_in import FOUND, stand_in
from tests.fleetsight.test_own_model import CRATE, two
from tests.waiting import PATIENCE_S, next_of


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
        ({"objects": [msgspec.structs.replace(CRATE, score=np.float32(0.5))]}, "numpy.float32 is unsupported; .* use"),
        ({"objects": [msgspec.structs.replace(CRATE, box=Box(*np.ones(4, np.float32)))]}, "numpy.float32 is unsupp"),
        ({"objects": [msgspec.structs.replace(CRATE, label=np.int64(1))]}, "numpy.int64 is unsupported"),
        ({"objects": [msgspec.structs.replace(CRATE, label=1 << 70)]}, ""),
        ({"objects": [msgspec.structs.replace(CRATE, name="\udc80")]}, "surrogates not allowed"),
        (
            {"objects": [msgspec.structs.replace(CRATE, name=f"{n:0256}") for n in range(1_000)]},
            "ClassList of .* bytes",
        ),
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


async def test_what_is_no_message_at_all_is_refused() -> None:
    async with two() as (_, own, other), own.results("r1", "front") as results:
        wanting = asyncio.create_task(next_of(aiter(other.detections())))
        await results.until_wanted()
        with pytest.raises(fleetsight.MessageError, match="results of r1/front: "):
            results.publish([CRATE])  # type: ignore[arg-type]
        wanting.cancel()
        await asyncio.wait([wanting])


def test_a_mask_of_another_size_is_an_error_of_ours() -> None:
    masked = msgspec.structs.replace(CRATE, mask=Mask(size=(3, 3), counts="09"))
    with pytest.raises(fleetsight.SchemaError, match=r"mask of \(3, 3\) in an image of \(4, 6\)") as refusal:
        msgspec.structs.replace(FOUND, objects=[masked])
    assert isinstance(refusal.value, fleetsight.FleetsightError)


async def test_nobody_wants_anything_once_the_context_has_ended() -> None:
    async with two() as (_, own, other):
        async with own.results("r1", "front") as results:
            wanting = asyncio.create_task(_listen(other))
            await results.until_wanted()
        assert not results.wanted
        async with asyncio.timeout(PATIENCE_S):
            await results.until_unwanted()
        with pytest.raises(fleetsight.ClosedError, match="results of r1/front: their context has ended"):
            await results.until_wanted()
        wanting.cancel()
        await asyncio.wait([wanting])


async def test_nobody_wants_anything_once_the_fleet_was_left() -> None:
    async with stand_in(worker=False) as there, fleetsight.connect(there.endpoint) as other:
        async with fleetsight.connect(there.endpoint) as own:
            used, unused = own.results("r1", "front"), own.results("r1", "rear")
            results, others = await used.__aenter__(), await unused.__aenter__()
            wanting = asyncio.create_task(_listen(other))
            await results.until_wanted()
            waiting = asyncio.create_task(others.until_wanted())
            ending = asyncio.create_task(results.until_unwanted())
        async with asyncio.timeout(PATIENCE_S):
            await ending
            with pytest.raises(fleetsight.ClosedError, match="results of r1/rear"):
                await waiting
        assert not results.wanted
        await unused.__aexit__(None, None, None)
        await used.__aexit__(None, None, None)
        wanting.cancel()
        await asyncio.wait([wanting])


async def _listen(fleet: fleetsight.Fleet) -> None:
    async for _ in fleet.detections("r1", "front"):
        pass
