"""A model of one's own, and results of one's own, over real sessions."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import numpy as np
import pytest

import fleetsight
from bus.sharing import watchdog
from fleetsight import Box, Detection, Fleet, ImageFrame, Mask
from schemas import codec, worker_keys
from schemas.detections import ClassList
from schemas.keys import Stream
from schemas.status import WorkerStatus
from tests.fleetsight.stand_in import FRONT, StandIn, stand_in
from tests.waiting import PATIENCE_S, next_of, receive, until

CRATE = Detection(name="crate", score=0.9, box=Box(0, 0, 2, 2))
POST = Detection(name="post", score=0.4, box=Box(2, 0, 3, 4))


@asynccontextmanager
async def two() -> AsyncIterator[tuple[StandIn, Fleet, Fleet]]:
    """A fleet without a detector, a program that has a model and one that wants results."""
    async with (
        stand_in(worker=False) as there,
        fleetsight.connect(there.endpoint) as own,
        fleetsight.connect(there.endpoint) as other,
    ):
        yield there, own, other


@asynccontextmanager
async def serving(fleet: Fleet, find: fleetsight.Find, **given: object) -> AsyncIterator[None]:
    async with asyncio.TaskGroup() as group:
        running = group.create_task(fleet.serve_model(find, model="crates", worker="mine", **given))  # type: ignore[arg-type]
        yield
        running.cancel()


async def crates(_: ImageFrame) -> Sequence[Detection]:
    return [POST, CRATE]


async def test_images_are_taken_while_somebody_wants_results_and_those_are_published() -> None:
    async with two() as (there, own, other), serving(own, crates):
        assert await next_of(aiter(other.workers())) == fleetsight.Change(
            fleetsight.WorkerName("detector", "mine"), here=True
        )
        assert not there.wanted(Stream.COLOR)
        found = await next_of(aiter(other.detections()))
        assert (found.objects, found.model, found.worker) == ([CRATE, POST], "crates", "mine")
        assert (found.width, found.height, found.header.robot) == (6, 4, "r1")
        await until(lambda: not there.wanted(Stream.COLOR))
        async for seen in other.class_lists("r1"):
            assert [(each.name, each.count) for each in seen.classes] == [("crate", 1), ("post", 1)]
            break
    await until(lambda: asyncio.all_tasks() == {asyncio.current_task()})


async def test_its_name_begins_with_its_certificates_as_routers_with_rules_demand() -> None:
    async with two() as (_, own, other):
        secured = Fleet(own._bus, own._iterations, Path("pki/gpu1.pem"))
        running = asyncio.create_task(secured.serve_model(crates, model="crates"))
        try:
            change = await next_of(aiter(other.workers()))
            assert change.who.worker.startswith("gpu1-")
        finally:
            running.cancel()


async def test_a_second_opinion_is_published_as_one() -> None:
    async with (
        two() as (there, own, _),
        there.bus.subscribe(FRONT.stream(Stream.OPINION), fleetsight.LATEST) as opinions,
        serving(own, crates, opinion=True, most_hz=5.0),
    ):
        assert (await next_of(opinions)).encoding == codec.encoding(ClassList)
        assert fleetsight.WorkerName("opinion", "mine") in await own.workers().present()


async def test_it_says_of_itself_what_it_did() -> None:
    async with (
        two() as (there, own, other),
        there.bus.subscribe(worker_keys.worker_status("detector", "mine"), fleetsight.LATEST) as statuses,
        serving(own, crates, classes=["crate", "post"]),
    ):
        async for _ in other.detections():
            break
        status = await receive(statuses, WorkerStatus)
        while not (status.cameras and status.cameras[0].inferred):
            status = await receive(statuses, WorkerStatus)
        assert (status.model, status.classes) == ("crates", ["crate", "post"])
        assert (status.cameras[0].robot, status.cameras[0].serving) == ("r1", True)


async def test_while_it_looks_the_newest_image_waits_and_the_others_are_counted() -> None:
    looked: list[int] = []
    may_go_on = asyncio.Event()

    async def find(image: ImageFrame) -> Sequence[Detection]:
        looked.append(image.header.seq)
        await may_go_on.wait()
        return []

    async with two() as (_, own, other), serving(own, find):
        coming = asyncio.create_task(next_of(aiter(other.detections())))
        await until(lambda: looked)
        await asyncio.sleep(0.5)
        may_go_on.set()
        await coming
        await until(lambda: len(looked) > 1)
    assert looked[1] > looked[0] + 2


async def test_while_it_does_not_answer_it_does_not_say_that_it_serves_the_camera(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(watchdog, "CHECK_S", 0.05)
    answer = asyncio.Event()

    async def find(_: ImageFrame) -> Sequence[Detection]:
        await answer.wait()
        return [CRATE]

    async with (
        two() as (there, own, other),
        there.bus.watch(worker_keys.every_serves("detector")) as serves,
        serving(own, find),
    ):
        assert (await next_of(serves)).alive
        wanting = asyncio.create_task(next_of(aiter(other.class_lists("r1"))))
        assert not (await next_of(serves)).alive
        answer.set()
        assert (await wanting).classes
        assert (await next_of(serves)).alive


async def test_what_it_raises_ends_it_and_is_raised() -> None:
    async def find(_: ImageFrame) -> Sequence[Detection]:
        raise ZeroDivisionError("mine")

    async with two() as (_, own, other):
        wanting = asyncio.create_task(next_of(aiter(other.class_lists())))
        with pytest.raises(ZeroDivisionError, match="mine"):
            await own.serve_model(find, model="crates")
        wanting.cancel()
        await asyncio.wait([wanting])


async def test_what_nobody_could_read_ends_it_too() -> None:
    async def find(_: ImageFrame) -> Sequence[Detection]:
        return [Detection(name="crate", score=90.0, box=Box(0, 0, 2, 2))]

    async with two() as (_, own, other):
        wanting = asyncio.create_task(next_of(aiter(other.class_lists())))
        with pytest.raises(fleetsight.MessageError, match=r"results of r1/front: .*score.*; nobody could read that"):
            await own.serve_model(find, model="crates")
        wanting.cancel()
        await asyncio.wait([wanting])


@pytest.mark.parametrize(
    ("returned", "said"),
    [
        ([msgspec.structs.replace(CRATE, score=np.float32(0.5))], "numpy.float32 is unsupported"),
        ([msgspec.structs.replace(CRATE, mask=Mask(size=(3, 3), counts="09"))], "mask of"),
        ([np.zeros(6)], "score"),
        (None, "not iterable"),
    ],
)
async def test_what_is_no_result_ends_it_too(returned: Sequence[Detection], said: str) -> None:
    async def find(_: ImageFrame) -> Sequence[Detection]:
        return returned

    async with two() as (_, own, other):
        wanting = asyncio.create_task(next_of(aiter(other.class_lists())))
        with pytest.raises(fleetsight.MessageError, match=f"results of r1/front: .*{said}.*; nobody could read that"):
            await own.serve_model(find, model="crates")
        wanting.cancel()
        await asyncio.wait([wanting])


async def test_what_is_cancelled_within_it_ends_it_and_leaves_the_cameras() -> None:
    async def find(_: ImageFrame) -> Sequence[Detection]:
        given_up: asyncio.Future[Sequence[Detection]] = asyncio.get_running_loop().create_future()
        given_up.cancel()
        return await given_up

    async with two() as (_, own, other):
        wanting = asyncio.create_task(next_of(aiter(other.class_lists())))
        async with asyncio.timeout(PATIENCE_S):
            with pytest.raises(fleetsight.FleetsightError, match="model crates: find was cancelled") as ended:
                await own.serve_model(find, model="crates")
        assert isinstance(ended.value.__cause__, asyncio.CancelledError)
        assert await other.workers("detector").present() == set()
        wanting.cancel()
        await asyncio.wait([wanting])


async def test_its_own_errors_of_ours_are_raised_as_they_are() -> None:
    async def find(_: ImageFrame) -> Sequence[Detection]:
        try:
            fleetsight.CameraKey("no name", "front")
        except fleetsight.SchemaError as error:
            raise fleetsight.SchemaError("mine") from error
        return []

    async with two() as (_, own, other):
        wanting = asyncio.create_task(next_of(aiter(other.class_lists())))
        with pytest.raises(fleetsight.SchemaError, match="mine") as ended:
            await own.serve_model(find, model="crates")
        assert str(ended.value) == "mine"
        assert "no name" in str(ended.value.__cause__)
        wanting.cancel()
        await asyncio.wait([wanting])


async def test_cancelling_it_while_it_looks_cancels_it() -> None:
    looks = asyncio.Event()

    async def find(_: ImageFrame) -> Sequence[Detection]:
        looks.set()
        await asyncio.Event().wait()
        return []

    async with two() as (_, own, other):
        wanting = asyncio.create_task(next_of(aiter(other.class_lists())))
        running = asyncio.create_task(own.serve_model(find, model="crates"))
        await looks.wait()
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running
        wanting.cancel()
        await asyncio.wait([wanting])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"model": "x" * 257}, "^model 'xxx.*length <= 256.*; give another"),
        ({"model": "\ud800"}, r"^model '\\ud800': .*surrogates"),
        ({"model": 3}, "^model 3: Expected `str`, got `int`"),
        ({"classes": ["a" * 257]}, "^classes .*length <= 256"),
        ({"classes": ["a"] * 1_001}, "^classes .*length <= 1000"),
        ({"classes": "crate"}, r"^classes 'crate': it is one text; give a list, such as \['crate'\]"),
        ({"robots": "r1"}, "^robots 'r1': it is one text"),
        ({"robots": 3}, "^robots 3: .*give a list"),
        ({"most_hz": float("nan")}, "^most_hz nan: "),
        ({"most_hz": -3}, "^most_hz -3: out of its bounds; use 0.001 Hz or more"),
        ({"most_hz": float("inf")}, "^most_hz inf: "),
        ({"most_hz": "fast"}, "^most_hz 'fast': "),
        ({"worker": "\ud800"}, "worker name"),
    ],
)
async def test_what_nobody_could_read_of_it_is_refused_at_once(
    fleet: Fleet, given: dict[str, object], said: str
) -> None:
    with pytest.raises(fleetsight.SettingsError, match=said):
        await fleet.serve_model(crates, **{"model": "crates", **given})  # type: ignore[arg-type]


async def test_the_longest_names_are_read(there: StandIn, fleet: Fleet) -> None:
    given = {"model": "é" * 256, "classes": [f"{number:é>256}" for number in range(1_000)]}
    async with there.bus.subscribe(worker_keys.worker_status("detector", "mine"), fleetsight.LATEST) as statuses:
        running = asyncio.create_task(fleet.serve_model(crates, worker="mine", **given))  # type: ignore[arg-type]
        status = await receive(statuses, WorkerStatus)
        assert {"model": status.model, "classes": status.classes} == given
        running.cancel()
        await asyncio.wait([running])


async def test_names_that_cannot_be_are_refused_at_once(fleet: Fleet) -> None:
    with pytest.raises(fleetsight.SettingsError, match="worker name 'a/b'"):
        await fleet.serve_model(crates, model="crates", worker="a/b")
    with pytest.raises(fleetsight.SettingsError, match=r"robot name 'r\*'"):
        await fleet.serve_model(crates, model="crates", robots=["r*"])


async def test_leaving_the_fleet_ends_it() -> None:
    async with stand_in(worker=False) as there:
        async with fleetsight.connect(there.endpoint) as fleet:
            running = asyncio.create_task(fleet.serve_model(crates, model="crates"))
            await fleet.workers("detector").present()
        with pytest.raises(fleetsight.ClosedError, match="model crates: the fleet was left before"):
            await running
