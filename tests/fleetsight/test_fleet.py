"""Questions to the fleet, and what comes where nobody answers."""

import asyncio
from contextlib import AsyncExitStack

import pytest

import fleetsight
from bus import MAX_REQUEST_BYTES, RefusedError, Reply, Request
from fleetsight import Fleet
from schemas import keys, worker_keys
from schemas.worker_keys import WorkerAlive
from tests.fleetsight.stand_in import FOUND, NO_IMAGE, SIGHTING, StandIn, stand_in
from tests.waiting import until


async def test_a_worker_says_what_is_in_an_image(fleet: Fleet) -> None:
    assert await fleet.detect(b"an image") == FOUND


async def test_what_is_no_image_is_refused_in_the_workers_words(fleet: Fleet) -> None:
    with pytest.raises(fleetsight.RefusedError) as refusal:
        await fleet.detect(NO_IMAGE)
    assert str(refusal.value) == "an image for a detector worker: worker w1: not an image"


async def test_what_is_too_large_is_not_sent(fleet: Fleet) -> None:
    with pytest.raises(fleetsight.SettingsError, match="an image of 16777217 bytes: at most 16777216 are sent"):
        await fleet.detect(bytes(MAX_REQUEST_BYTES + 1))


async def test_the_monitor_says_what_it_knows(fleet: Fleet) -> None:
    assert (await fleet.inventory()).sightings == [SIGHTING]
    assert (await fleet.inventory(robot="r2")).sightings == []


async def test_an_image_file_may_be_any_bytes(fleet: Fleet) -> None:
    assert await fleet.detect(bytearray(b"an image")) == FOUND
    assert await fleet.detect(memoryview(b"an image")) == FOUND
    for image in ("picture.jpg", None, 3):
        with pytest.raises(fleetsight.SettingsError, match=f"^image {image!r}: these are no bytes"):
            await fleet.detect(image)  # type: ignore[arg-type]
    with pytest.raises(fleetsight.SettingsError, match="timeout_s nan: "):
        await fleet.detect(b"an image", timeout_s=float("nan"))


@pytest.mark.parametrize(
    "given",
    [
        {"robot": "r/1"},
        {"robot": None},
        {"robot": 3},
        {"camera": "*"},
        {"name": "\ud800"},
        {"name": "x" * 257},
        {"name": None},
        {"in_view": "yes"},
        {"timeout_s": 61},
        {"timeout_s": 0},
        {"timeout_s": float("nan")},
        {"timeout_s": None},
        {"timeout_s": "5 s"},
    ],
)
async def test_a_question_that_cannot_be_is_refused_at_once(fleet: Fleet, given: dict[str, object]) -> None:
    with pytest.raises(fleetsight.SettingsError, match=f"^{next(iter(given))} .*: .*; |^.* name .*: use "):
        await fleet.inventory(**given)  # type: ignore[arg-type]


async def test_the_world_has_each_object_once(fleet: Fleet) -> None:
    answer = await fleet.world("hall")
    assert (answer.site, [each.id for each in answer.objects], answer.complete) == ("hall", ["h-1"], True)
    assert (await fleet.world("hall", name="box")).objects == []
    assert (await fleet.world("hall", region=[(8, 8), (9, 8), (9, 9)], robot="r1", seen_within_s=2.0)).objects == []


@pytest.mark.parametrize(
    "given",
    [
        {"site": "a/b"},
        {"robot": "*"},
        {"name": "x" * 257},
        {"region": [(0, float("nan"))]},
        {"region": [(0, 0, 0)]},
        {"seen_within_s": -1.0},
        {"timeout_s": 0},
    ],
)
async def test_a_question_about_the_world_that_cannot_be_is_refused_at_once(
    fleet: Fleet, given: dict[str, object]
) -> None:
    with pytest.raises(fleetsight.SettingsError, match=f"^{next(iter(given))} "):
        await fleet.world(**given)  # type: ignore[arg-type]


async def test_a_site_that_nobody_keeps_says_what_to_start(fleet: Fleet) -> None:
    with pytest.raises(fleetsight.NoWorldModelError) as error:
        await fleet.world("elsewhere")
    assert str(error.value) == (
        "the world of site elsewhere: no server has this key, or it left before answering; "
        "start one with `fleetsight worldmodel`"
    )


async def test_without_anybody_to_answer_the_error_says_whom_to_start() -> None:
    async with stand_in(worker=False, monitor=False) as there, fleetsight.connect(there.endpoint) as fleet:
        with pytest.raises(fleetsight.NoWorkerError) as worker:
            await fleet.detect(b"an image", timeout_s=0.3)
        with pytest.raises(fleetsight.NoMonitorError) as monitor:
            await fleet.inventory()
    assert str(worker.value) == (
        "an image for a detector worker: no detector worker was seen within 0.3 s; start one with `fleetsight detector`"
    )
    assert str(monitor.value) == (
        "the inventory: no server has this key, or it left before answering; start one with `fleetsight monitor`"
    )


async def test_without_a_link_that_is_the_cause_whoever_was_to_answer() -> None:
    async with AsyncExitStack() as stack:
        async with stand_in() as there:
            fleet = await stack.enter_async_context(fleetsight.connect(there.endpoint))
        await until(lambda: fleet.problem)
        with pytest.raises(fleetsight.ConnectError) as worker:
            await fleet.detect(b"an image", timeout_s=0.3)
        with pytest.raises(fleetsight.ConnectError) as monitor:
            await fleet.inventory(timeout_s=0.3)
    cause = f"there is no link to {there.endpoint}; wait until `fleet.problem` is empty, and see that the router runs"
    assert str(worker.value) == f"an image for a detector worker: {cause}"
    assert str(monitor.value) == f"the inventory: {cause}"


async def test_an_answer_that_comes_too_late_or_is_none_is_an_error() -> None:
    async def wait(_: Request) -> Reply:
        await asyncio.sleep(60)
        raise RefusedError("too late")

    async def babble(_: Request) -> Reply:
        return Reply(b"no inventory")

    async with (
        stand_in(worker=False, monitor=False) as there,
        there.bus.announce(str(WorkerAlive("detector", "slow"))),
        there.bus.serve(worker_keys.infer("slow"), wait),
        there.bus.serve(keys.INVENTORY, babble),
        fleetsight.connect(there.endpoint) as fleet,
    ):
        with pytest.raises(
            fleetsight.AnswerTimeoutError, match=r"an image for a detector worker: .*; give it more time"
        ):
            await fleet.detect(b"an image", timeout_s=1.5)
        with pytest.raises(fleetsight.MessageError, match="the inventory: encoded as"):
            await fleet.inventory()


async def test_a_fleet_that_was_left_is_asked_nothing(there: StandIn) -> None:
    async with fleetsight.connect(there.endpoint) as fleet:
        pass
    assert fleet.problem
    with pytest.raises(fleetsight.ClosedError, match="the inventory: the fleet was left before"):
        await fleet.inventory()
    with pytest.raises(fleetsight.ClosedError):
        await fleet.detect(b"an image")
    with pytest.raises(fleetsight.ClosedError, match="results of r1/front"):
        async with fleet.results("r1", "front"):
            raise AssertionError
