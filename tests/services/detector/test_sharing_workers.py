"""Several workers on a fake bus, and cameras that send to whoever wants their frames."""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress

import msgspec
import pytest

from bus import QUEUE, Bus, Publisher, QoS, Subscription, Watch
from bus.fake import FakeNetwork
from bus.sharing.camera_assignment import owner
from schemas import codec, consumer_keys, keys, worker_keys
from schemas.budget import RateBudget
from schemas.detections import ClassList
from schemas.image import ImageFrame
from schemas.keys import CameraKey, Stream
from schemas.worker_keys import WorkerAlive
from services.detector.process import DetectorWorker
from tests.schemas.frames import header, image
from tests.services.detector.support.told_model import ToldModel
from tests.waiting import next_of, until

CAMERAS = [CameraKey("r1", f"c{number}") for number in range(4)]
A, B = (WorkerAlive("detector", name) for name in "ab")
OF_B = {camera.camera for camera in CAMERAS if owner(camera, {A, B}) == "b"}
OF_A = {camera.camera for camera in CAMERAS} - OF_B
ENCODING = codec.encoding(ClassList)
BUDGET = codec.encoding(RateBudget)


class Rig:
    """Four cameras whose class lists are wanted."""

    def __init__(self, network: FakeNetwork, bus: Bus, cameras: list[Publisher], lists: Subscription) -> None:
        self._network = network
        self._cameras = cameras
        self._lists = lists
        self._seq = 0
        self._taken = 0
        self.bus = bus

    @asynccontextmanager
    async def worker(self, token: WorkerAlive, model: ToldModel) -> AsyncIterator[None]:
        async with self._network.open_bus() as bus, asyncio.TaskGroup() as group:
            working = group.create_task(DetectorWorker(bus, model, [token], max_age_s=60, join_s=0.05).run())
            yield
            working.cancel()

    async def wanted(self) -> None:
        await until(lambda: all(camera.wanted for camera in self._cameras))

    def send(self) -> None:
        """Send a frame of each camera."""
        self._seq += 1
        for key, camera in zip(CAMERAS, self._cameras, strict=True):
            about = header(robot=key.robot, camera=key.camera, seq=self._seq)
            camera.put(codec.encode(msgspec.structs.replace(image(), header=about)))

    async def seen(self, count: int) -> Counter[tuple[str, str]]:
        """Take so many results; return the worker and camera of each."""
        self._taken += count
        found = [codec.decode(ClassList, (await next_of(self._lists)).payload, ENCODING) for _ in range(count)]
        return Counter((each.worker, each.header.camera) for each in found)

    async def shared(self, expected: dict[str, set[str]]) -> None:
        """Send until each worker gives results of its own cameras, and of no others."""
        once = Counter((worker, camera) for worker, cameras in expected.items() for camera in cameras)
        async with asyncio.timeout(60):
            while True:
                await asyncio.sleep(0.05)
                self.send()
                with suppress(TimeoutError):
                    async with asyncio.timeout(1):
                        while self._lists.counts.received - self._taken < len(CAMERAS):  # noqa: ASYNC110 - nobody tells
                            await asyncio.sleep(0.005)
                await asyncio.sleep(0.05)
                if await self.seen(self._lists.counts.received - self._taken) == once:
                    return


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    network = FakeNetwork()
    async with AsyncExitStack() as stack:
        bus = await stack.enter_async_context(network.open_bus())
        encoding, cameras = codec.encoding(ImageFrame), []
        for key in CAMERAS:
            color = bus.publisher(key.stream(Stream.COLOR), QoS.IMAGE, encoding=encoding)
            cameras.append(await stack.enter_async_context(color))
            await stack.enter_async_context(bus.announce(key.alive(Stream.COLOR)))
        lists = await stack.enter_async_context(
            bus.subscribe(keys.every_stream(Stream.CLASSES), QUEUE(999), history=False)
        )
        yield Rig(network, bus, cameras, lists)


async def test_each_camera_has_one_worker_and_another_when_that_one_leaves(rig: Rig) -> None:
    async with rig.worker(A, ToldModel(at_once=True)):
        await rig.shared({"a": OF_A | OF_B})
        async with rig.worker(B, ToldModel(at_once=True)):
            await rig.shared({"a": OF_A, "b": OF_B})
        await rig.shared({"a": OF_A | OF_B})


async def test_a_worker_that_ends_publishes_what_is_in_the_model(rig: Rig) -> None:
    model = ToldModel(max_batch=6)
    async with rig.worker(A, model):
        await rig.wanted()
        rig.send()
        await until(lambda: len(model.calls) == 1)
        asyncio.get_running_loop().call_later(0.1, model.answers[0].set)
    assert await rig.seen(len(CAMERAS)) == Counter(("a", camera) for camera in OF_A | OF_B)


async def test_a_model_that_hangs_does_not_keep_a_worker_from_ending(rig: Rig) -> None:
    model = ToldModel()
    async with asyncio.timeout(60), rig.worker(A, model):
        await rig.wanted()
        rig.send()
        await until(lambda: len(model.calls) == 1)


async def test_cameras_of_a_worker_whose_model_hangs_are_served_by_another_until_it_answers(rig: Rig) -> None:
    hung = ToldModel()
    async with rig.worker(A, hung), rig.bus.watch(worker_keys.every_serves("detector")) as serves:
        await rig.wanted()
        rig.send()
        await until(lambda: len(hung.calls) == 1)
        async with rig.worker(B, ToldModel(at_once=True)):
            await rig.shared({"b": OF_A | OF_B})
            assert {worker_keys.parse_serves(each).worker for each in await _shown(serves)} == {"b"}
            hung.answer_at_once()
            await rig.shared({"a": OF_A, "b": OF_B})


async def _shown(serves: Watch) -> set[str]:
    """Return the tokens that are there."""
    shown = set[str]()
    with suppress(TimeoutError):
        async with asyncio.timeout(0.1):
            async for presence in serves:
                (shown.add if presence.alive else shown.discard)(presence.key)
    return shown


async def test_a_worker_that_cannot_keep_up_says_what_it_can_use(rig: Rig) -> None:
    model = ToldModel()
    async with (
        rig.bus.subscribe(consumer_keys.every_budget("r1"), QUEUE(99)) as budgets,
        rig.worker(A, model),
        asyncio.TaskGroup() as group,
    ):
        await rig.wanted()
        flooding = group.create_task(_flood(rig, model))
        said = [codec.decode(RateBudget, (await next_of(budgets)).payload, BUDGET) for _ in CAMERAS]
        flooding.cancel()
    assert {each.camera for each in said} == OF_A | OF_B
    assert {(each.robot, each.stream, each.consumer) for each in said} == {("r1", "color", "a")}
    assert all(each.hz is not None and each.hz < 10 for each in said)
    assert len({each.wait_s for each in said}) == len(CAMERAS)


async def _flood(rig: Rig, model: ToldModel) -> None:
    """Send 50 frames a second of each camera to a model that looks at 20 a second."""
    for tick in range(500):
        rig.send()
        if tick % 5 in {0, 2} and model.answers:
            model.answers[-1].set()
        await asyncio.sleep(0.02)
