"""What is particular to one worker's place among others; how two share is in tests/contract."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack

import pytest

from bus.demand import SharedDemand
from bus.fake import FakeNetwork
from bus.sharing import Sharing, SharingSettings
from bus.sharing.sharing import say_unwanted
from schemas.keys import CameraKey, Stream
from schemas.worker_keys import Serves
from tests.contract.test_sharing import CAMERAS, A, B, Worker, cameras
from tests.waiting import until


async def test_no_more_cameras_than_it_may(caplog: pytest.LogCaptureFixture) -> None:
    network, served = FakeNetwork(), set[CameraKey]()

    async def serve(camera: CameraKey, _: Callable[[], None]) -> None:
        served.add(camera)
        await asyncio.Event().wait()

    async with network.open_bus() as ours, network.open_bus() as theirs, cameras(theirs), asyncio.TaskGroup() as group:
        task = group.create_task(Sharing(ours, [A], Stream.COLOR, serve, most=3, join_s=0).run())
        await until(lambda: len(served) == 3)
        task.cancel()
    assert "this worker serves 3, its limit" in caplog.text


async def test_what_fails_in_the_work_ends_the_sharing() -> None:
    network = FakeNetwork()

    async def serve(camera: CameraKey, _: Callable[[], None]) -> None:
        raise RuntimeError(str(camera))

    async with network.open_bus() as ours, network.open_bus() as theirs, cameras(theirs):
        with pytest.raises(ExceptionGroup):
            await Sharing(ours, [A], Stream.COLOR, serve, join_s=0).run()
        async with theirs.watch("workers/**") as watch:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(anext(watch), 0.01)


async def test_a_camera_that_blinks_is_served_by_one_task_at_a_time() -> None:
    network = FakeNetwork()
    async with network.open_bus() as ours, network.open_bus() as theirs, Worker(ours, A, join_s=0).running() as a:
        for pause_s in (0, 0.04, 0.1):
            async with cameras(theirs):
                await asyncio.sleep(pause_s)
        async with cameras(theirs):
            await until(lambda: a.serves == set(CAMERAS))


async def test_a_camera_that_blinks_twice_while_its_work_ends_is_served_once() -> None:
    network, front = FakeNetwork(), CAMERAS[0]
    under_way = most = begun = 0

    async def serve(_: CameraKey, __: Callable[[], None]) -> None:
        nonlocal under_way, most, begun
        under_way, begun = under_way + 1, begun + 1
        most = max(most, under_way)
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0.6)
            under_way -= 1

    async with network.open_bus() as ours, network.open_bus() as theirs, asyncio.TaskGroup() as group:
        task = group.create_task(Sharing(ours, [A], Stream.COLOR, serve, join_s=0).run())
        for _ in range(2):
            async with theirs.announce(front.alive(Stream.COLOR)):
                await asyncio.sleep(0.1)
            await asyncio.sleep(0.1)
        async with theirs.announce(front.alive(Stream.COLOR)):
            await until(lambda: begun == 2)
        task.cancel()
    assert most == 1


async def test_who_leaves_ends_each_camera_in_order_whenever_it_was_taken_over() -> None:
    network, begun, ended = FakeNetwork(), set[CameraKey](), set[CameraKey]()

    async def serve(camera: CameraKey, _: Callable[[], None]) -> None:
        begun.add(camera)
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0.3)
            ended.add(camera)

    async with (
        network.open_bus() as ours,
        network.open_bus() as theirs,
        cameras(theirs),
        AsyncExitStack() as stack,
        asyncio.TaskGroup() as group,
    ):
        task = group.create_task(Sharing(ours, [A], Stream.COLOR, serve, join_s=0).run())
        await until(lambda: begun == set(CAMERAS))
        await stack.enter_async_context(theirs.announce(str(B)))
        await asyncio.sleep(0.1)
        task.cancel()
        for camera in CAMERAS:
            await asyncio.sleep(0.05)
            await stack.enter_async_context(theirs.announce(str(Serves("detector", "b", camera))))
    assert ended == set(CAMERAS)


async def test_another_worker_of_the_same_name_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    network = FakeNetwork()
    async with network.open_bus() as ours, network.open_bus() as theirs, Worker(theirs, A, join_s=0).running():
        await asyncio.sleep(0.02)
        assert "another worker" not in caplog.text
        async with Worker(ours, A, join_s=0.05).running():
            await until(lambda: "another worker is also called a" in caplog.text)


async def test_a_worker_for_two_robots_takes_no_other() -> None:
    network = FakeNetwork()
    tokens = SharingSettings(worker="a", robots=["r2", "r3"]).tokens("detector")
    served = set[CameraKey]()

    async def serve(camera: CameraKey, _: Callable[[], None]) -> None:
        served.add(camera)
        await asyncio.Event().wait()

    fronts = [CameraKey(robot, "front") for robot in ("r1", "r2", "r3")]
    async with network.open_bus() as ours, network.open_bus() as theirs, AsyncExitStack() as stack:
        for camera in fronts:
            await stack.enter_async_context(theirs.announce(camera.alive(Stream.COLOR)))
        async with asyncio.TaskGroup() as group:
            task = group.create_task(Sharing(ours, tokens, Stream.COLOR, serve, join_s=0).run())
            await until(lambda: served == set(fronts[1:]))
            task.cancel()


async def test_a_camera_is_taken_over_without_results_only_where_none_are_wanted() -> None:
    demand, taken = SharedDemand(), asyncio.Event()
    want = demand.of("distances")
    want(True)  # noqa: FBT003 - the bus calls it so
    saying = asyncio.create_task(say_unwanted(demand, taken.set))
    await asyncio.sleep(0)
    assert not taken.is_set()
    want(False)  # noqa: FBT003
    await saying
    assert taken.is_set()
