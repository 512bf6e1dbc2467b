"""The uplink's budget on a real Zenoh link that carries little more: hardly anything is queued, in Zenoh either."""

import asyncio
import os
import time
from contextlib import AsyncExitStack

from bus import QUEUE, Bus, BusSettings, open_bus
from gateway.to_bus.shaping.consumers import Consumers
from gateway.to_bus.shaping.settings import ShapingSettings
from gateway.to_bus.shaping.shaping import Shaping
from gateway.to_bus.shaping.stream_output import StreamOutput
from gateway.to_bus.translators import kind_of
from schemas.keys import SensorKey, sensor_key
from schemas.ros import RawMessage
from schemas.status import OVER_BUDGET
from schemas.transforms import Transforms
from services.toolbox.demo.children import free_ports
from tests.integration.network.thin_link import ThinLink, thin_link
from tests.schemas.frames import header
from tests.waiting import until

LINK_BYTES_PER_S = 1_000_000
BUDGET_MBIT = 7
AHEAD_BYTES = BUDGET_MBIT * 1_000_000 / 8 * 0.1
ROUNDS = 70
LOOKS, LOOK_S = 4, 0.007
ROBOT = "r1"
FRAMES = (sensor_key(ROBOT, "ros/left"), sensor_key(ROBOT, "ros/right"))
TF = sensor_key(ROBOT, "tf")


def frame() -> RawMessage:
    data = memoryview(os.urandom(20_000))
    return RawMessage(header=header(camera=""), type="a/B", md5="", definition="", latched=False, data=data)


async def opened(stack: AsyncExitStack, bus: Bus, shaping: Shaping, key: SensorKey) -> StreamOutput:
    kind = kind_of(key)
    publisher = await stack.enter_async_context(bus.publisher(str(key), kind.qos, encoding=kind.encoding))
    while not publisher.wanted:  # noqa: ASYNC110 - nobody tells
        await asyncio.sleep(0.02)
    return stack.enter_context(shaping.output(key, publisher))


async def overload(frames: list[StreamOutput], transforms: StreamOutput, link: ThinLink) -> float:
    """Send half more than the link carries for a while; return the most bytes that were given and not carried.

    A busy machine sleeps longer, and then more frames come at once.
    """
    most, before, sent = 0.0, link.passed, 0
    began_s = time.monotonic()
    for _ in range(ROUNDS):
        due = 1 + int((time.monotonic() - began_s) / (LOOKS * LOOK_S))
        for output in frames * (due - sent):
            output.put(frame())
        sent = due
        transforms.put(Transforms(header=header(camera=""), transforms=[]))
        for _ in range(LOOKS):
            await asyncio.sleep(LOOK_S)
            given = sum(output.counts.bytes for output in (*frames, transforms))
            most = max(most, given - (link.passed - before))
    return most


async def test_what_the_link_was_given_and_has_not_carried_stays_within_the_budgets_promise() -> None:
    async with AsyncExitStack() as stack:
        port = free_ports(1)
        router = await stack.enter_async_context(
            open_bus(BusSettings(mode="router", listen=[f"tcp/127.0.0.1:{port}"], shared_memory=False))
        )
        link, through = await stack.enter_async_context(thin_link(port, LINK_BYTES_PER_S))
        here = await stack.enter_async_context(
            open_bus(BusSettings(connect=[f"tcp/127.0.0.1:{through}"], shared_memory=False))
        )
        shaping = Shaping(ShapingSettings(uplink_mbit=BUDGET_MBIT), Consumers(ROBOT, "here", near=False))
        running = asyncio.create_task(shaping.run(here))
        arrived = [
            await stack.enter_async_context(router.subscribe(str(key), QUEUE(999), history=False))
            for key in (*FRAMES, TF)
        ]
        left, right, transforms = [await opened(stack, here, shaping, key) for key in (*FRAMES, TF)]
        most = await overload([left, right], transforms, link)
        await until(lambda: arrived[2].counts.received == ROUNDS, "no transforms are left out")
        running.cancel()
        await asyncio.wait([running])
        assert most < 3 * AHEAD_BYTES, "without a budget it soon is all that Zenoh and the system take: over 1 MiB"
        assert all(subscription.counts.received > ROUNDS / 4 for subscription in arrived), "both cameras get through"
        assert min(output.counts.dropped[OVER_BUDGET] for output in (left, right)) > 0
