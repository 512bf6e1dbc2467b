"""Whatever happens to a stream, what it received is what reached its publishers and what was dropped for a reason."""

import asyncio
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import AsyncExitStack, contextmanager
from random import Random

import numpy as np
import pytest

from bus import QUEUE, Bus, Presence, Publisher
from bus.fake import FakeNetwork
from gateway.discovery.plan import NO_PLAN, Plan, Source
from gateway.offers import Offers
from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.node import Node
from gateway.ros1.tcpros.publisher import Publication
from gateway.to_bus.shaping.consumers import Consumers
from gateway.to_bus.shaping.settings import ShapingSettings
from gateway.to_bus.shaping.shaping import Shaping
from gateway.to_bus.shaping.stream_output import StreamOutput
from gateway.to_bus.stream import MALFORMED
from schemas.consumer_keys import Wanted
from schemas.keys import CameraKey, SensorKey, Stream, StreamKey
from schemas.status import ENDED, OVER_BUDGET, REPLACED_BEFORE_SHAPING, StreamStatus
from services.simulator.ros_master.master import RosMaster
from tests.waiting import until

COLOR = StreamKey(CameraKey("r1", "front"), Stream.COLOR)
TOPICS = ("/front/color/image_raw", "/front/image_raw")
NOISE = np.random.default_rng(1).integers(0, 256, 300 * 400 * 3, np.uint8).tobytes()


def picture(at_ms: int) -> bytes:
    stamp_s, stamp_ms = divmod(at_ms, 1000)
    return encode_image(
        Image(
            seq=0,
            stamp_s=stamp_s,
            stamp_ns=stamp_ms * 1_000_000,
            frame_id="",
            height=300,
            width=400,
            encoding="rgb8",
            is_bigendian=False,
            step=1200,
            data=memoryview(NOISE),
        )
    )


class RecordingShaping(Shaping):
    """Remembers every publisher that something may be put to."""

    def __init__(self, settings: ShapingSettings, consumers: Consumers) -> None:
        super().__init__(settings, consumers)
        self.publishers: list[Publisher] = []

    @contextmanager
    def output(self, key: SensorKey, publisher: Publisher) -> Iterator[StreamOutput]:
        self.publishers.append(publisher)
        with super().output(key, publisher) as output:
            yield output

    @property
    def sent(self) -> int:
        return sum(each.counts.put - each.counts.dropped for each in self.publishers)


class Life:
    """One stream, its two cameras (one of them latches) and who listens, all of which come and go."""

    def __init__(
        self, random: Random, bus: Bus, nodes: tuple[Node, Node], offers: Offers, consumers: Consumers
    ) -> None:
        self._random = random
        self._bus = bus
        self._nodes = nodes
        self._offers = offers
        self._consumers = consumers
        self._publications: dict[Node, tuple[AsyncExitStack, Publication]] = {}
        self._listening: AsyncExitStack | None = None
        self._at_ms = 1_000_000

    async def go_on(self) -> None:
        """Let something happen."""
        steps = (self.publish, self.publish, self.publish, self.listen, self.token, self.camera, self.plan)
        await self._random.choice(steps)()
        await asyncio.sleep(self._random.choice((0, 0, 0.001, 0.03)))

    async def publish(self) -> None:
        for _, publication in self._publications.values():
            for _ in range(self._random.randint(1, 4)):
                self._at_ms += self._random.choice((5, 40))
                publication.publish(b"garbage" if self._random.random() < 0.1 else picture(self._at_ms))
                await asyncio.sleep(0)

    async def listen(self) -> None:
        if self._listening is not None:
            await self._listening.aclose()
            self._listening = None
            return
        self._listening = AsyncExitStack()
        await self._listening.enter_async_context(self._bus.subscribe(str(COLOR), QUEUE(9)))
        await asyncio.sleep(0.05)

    async def token(self) -> None:
        where = self._random.choice(("here", "there"))
        self._consumers.note(Presence(str(Wanted(COLOR, where, "w1")), self._random.random() < 0.5))

    async def camera(self) -> None:
        node = self._random.choice(self._nodes)
        if node in self._publications:
            await self._publications.pop(node)[0].aclose()
            return
        stack = AsyncExitStack()
        latch = node is self._nodes[0]
        topic = self._random.choice((*TOPICS, TOPICS[0]))
        publication = await stack.enter_async_context(node.advertise(topic, TYPE_NAME, latch=latch, queue_size=9))
        self._publications[node] = (stack, publication)
        await asyncio.sleep(0.05)

    async def plan(self) -> None:
        await self._offers.change(self._random.choice((NO_PLAN, planned(TOPICS[0]), planned(TOPICS[1]))))

    async def end(self) -> None:
        for stack, _ in self._publications.values():
            await stack.aclose()
        if self._listening is not None:
            await self._listening.aclose()


def planned(topic: str) -> Plan:
    return Plan({COLOR: Source(topic)})


class Rig:
    def __init__(self, shaping: RecordingShaping, offers: Offers, bus: Bus, node: Node, life: Life) -> None:
        self.shaping = shaping
        self.offers = offers
        self.bus = bus
        self.node = node
        self.life = life

    async def account(self) -> StreamStatus:
        """Withdraw the stream, with whatever is under way, and return what is said when it is offered again."""
        await self.offers.change(NO_PLAN)
        await self.offers.change(planned(TOPICS[0]))
        (status,) = self.offers.streams()
        return status


@pytest.fixture
async def rig(settings: Mapping[str, object], seed: int) -> AsyncIterator[Rig]:
    network, consumers = FakeNetwork(), Consumers("r1", "here", near=True)
    shaping = RecordingShaping(ShapingSettings.model_validate(settings), consumers)
    async with AsyncExitStack() as stack:
        theirs = await stack.enter_async_context(network.open_bus())
        ours = await stack.enter_async_context(network.open_bus())
        master = await stack.enter_async_context(RosMaster())
        latching = await stack.enter_async_context(Node("/latching", master_uri=master.uri))
        camera = await stack.enter_async_context(Node("/camera", master_uri=master.uri))
        node = await stack.enter_async_context(Node("/gateway", master_uri=master.uri))
        async with asyncio.TaskGroup() as group:
            running = group.create_task(shaping.run(ours))
            offers = Offers(group, ours, node, boot_id="boot", shaping=shaping, returned=lambda _, __: [])
            random = Random(seed)  # noqa: S311 - nothing secret
            life = Life(random, theirs, (latching, camera), offers, consumers)
            yield Rig(shaping, offers, theirs, camera, life)
            await life.end()
            await offers.close()
            running.cancel()


EVERYTHING = {"max_hz": "30", "uplink_mbit": 40, "compression": "auto", "scale": "*/color=1/2"}


@pytest.mark.parametrize(
    ("settings", "seed"),
    [(EVERYTHING, 1), (EVERYTHING, 2), ({"compression": "png"}, 3), ({"uplink_mbit": 1, "compression": "raw"}, 4)],
)
async def test_a_messy_life_adds_up(rig: Rig) -> None:
    await rig.offers.change(planned(TOPICS[0]))
    for _ in range(4):
        for _ in range(30):
            await rig.life.go_on()
        status = await rig.account()
        assert status.received == status.forwarded + sum(status.dropped.values())
        assert status.forwarded == rig.shaping.sent


@pytest.mark.parametrize(
    ("settings", "seed", "latch", "reasons"),
    [
        ({"compression": "png"}, 0, False, {REPLACED_BEFORE_SHAPING, ENDED}),
        ({"compression": "png"}, 0, True, {REPLACED_BEFORE_SHAPING, ENDED}),
        ({"compression": "raw", "uplink_mbit": 0.1}, 0, False, {OVER_BUDGET, ENDED}),
        ({"compression": "raw", "uplink_mbit": 0.1}, 0, True, {OVER_BUDGET, ENDED}),
    ],
)
async def test_what_waits_when_a_stream_ends_was_not_forwarded(rig: Rig, *, latch: bool, reasons: set[str]) -> None:
    await rig.offers.change(planned(TOPICS[0]))
    async with (
        rig.bus.subscribe(str(COLOR), QUEUE(99)),
        rig.node.advertise(TOPICS[0], TYPE_NAME, latch=latch, queue_size=9) as publication,
    ):
        await until(lambda: publication.subscriber_count, "it is subscribed")
        for seq in range(8):
            publication.publish(picture(seq))
        publication.publish(b"garbage")
        await until(lambda: MALFORMED in rig.offers.streams()[0].dropped, "all have come")
        status = await rig.account()
    assert status.forwarded == rig.shaping.sent
    assert status.received == 9
    assert status.dropped.keys() == reasons | {MALFORMED}
