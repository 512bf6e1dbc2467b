"""Two workers that share cameras, over the fake bus and over Zenoh: nothing unowned, a short overlap, no gap."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager

from bus import Bus
from bus.sharing import Sharing
from bus.sharing.camera_assignment import owner
from schemas import worker_keys
from schemas.keys import CameraKey, Stream
from schemas.worker_keys import Serves, WorkerAlive
from tests.waiting import next_of, until

CAMERAS = [CameraKey("r1", f"c{number}") for number in range(8)]
A, B = (WorkerAlive("detector", name) for name in "ab")
OF_B = {camera for camera in CAMERAS if owner(camera, {A, B}) == "b"}
OF_A = set(CAMERAS) - OF_B


class Worker:
    """Notes what it looks after; takes over at once, or when it is told to."""

    def __init__(self, bus: Bus, token: WorkerAlive, *, at_once: bool = True, join_s: float = 0.1) -> None:
        self.serves: set[CameraKey] = set()
        self.may_take_over = asyncio.Event()
        if at_once:
            self.may_take_over.set()
        self.sharing = Sharing(bus, [token], Stream.COLOR, self._serve, join_s=join_s)

    async def _serve(self, camera: CameraKey, took_over: Callable[[], None]) -> None:
        assert camera not in self.serves
        self.serves.add(camera)
        try:
            await self.may_take_over.wait()
            took_over()
            await asyncio.Event().wait()
        finally:
            self.serves.remove(camera)

    @asynccontextmanager
    async def running(self) -> AsyncIterator["Worker"]:
        async with asyncio.TaskGroup() as group:
            task = group.create_task(self.sharing.run())
            yield self
            task.cancel()


@asynccontextmanager
async def cameras(bus: Bus) -> AsyncIterator[None]:
    async with AsyncExitStack() as stack:
        for camera in CAMERAS:
            await stack.enter_async_context(bus.announce(camera.alive(Stream.COLOR)))
        yield


async def test_a_worker_that_joins_takes_over_what_falls_to_it_and_leaves_it_again(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with cameras(there), Worker(here, A).running() as a:
        await until(lambda: a.serves == set(CAMERAS))
        async with Worker(there, B).running() as b:
            await until(lambda: (a.serves, b.serves) == (OF_A, OF_B))
            await asyncio.sleep(0.1)  # b hears that a serves them no longer, so it waits for a when it leaves
        assert b.serves == set()
        assert a.serves == set(CAMERAS)


async def test_the_old_one_goes_on_until_the_new_one_has_taken_over(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with cameras(there), Worker(here, A).running() as a:
        await until(lambda: a.serves == set(CAMERAS))
        async with Worker(there, B, at_once=False).running() as b:
            await until(lambda: b.serves == OF_B)
            assert a.serves == set(CAMERAS)
            b.may_take_over.set()
            await until(lambda: a.serves == OF_A)


async def test_cameras_come_and_go(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with Worker(here, A).running() as a:
        async with cameras(there):
            await until(lambda: a.serves == set(CAMERAS))
        await until(lambda: a.serves == set())
        async with cameras(there):
            await until(lambda: a.serves == set(CAMERAS))


async def test_others_see_who_has_taken_a_camera_over(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    async with (
        there.watch(worker_keys.every_serves("detector")) as watch,
        there.announce(CAMERAS[0].alive(Stream.COLOR)),
    ):
        async with Worker(here, A).running():
            seen = await next_of(watch)
            assert (worker_keys.parse_serves(seen.key), seen.alive) == (Serves("detector", "a", CAMERAS[0]), True)
        assert not (await next_of(watch)).alive


async def test_what_is_no_workers_token_is_left_out(buses: tuple[Bus, Bus]) -> None:
    here, there = buses
    wrong = ("workers/detector/b/x/-/alive", "workers/detector/b/9999/-/alive", "fleet/r1/status/color/alive")
    async with AsyncExitStack() as stack:
        for key in wrong:
            await stack.enter_async_context(there.announce(key))
        async with cameras(there), Worker(here, A).running() as a:
            await until(lambda: a.serves == set(CAMERAS))
