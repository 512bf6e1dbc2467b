"""Cancelled at any await, a gateway's shaping leaves nothing: no task, and nobody that watches."""

import asyncio

from bus import QUEUE
from bus.fake import FakeNetwork
from gateway.to_bus.shaping.consumers import Consumers
from gateway.to_bus.shaping.settings import ShapingSettings
from gateway.to_bus.shaping.shaping import Shaping
from gateway.to_bus.translators import kind_of
from schemas.keys import sensor_key
from tests.gateway.ros1.support.cancelling import cancel_everywhere
from tests.gateway.to_bus.shaping.rig import numbered

COLOR = sensor_key("r1", "front/color")


async def test_a_stream_that_is_compressed_and_waits_for_the_uplink() -> None:
    network = FakeNetwork()
    async with network.open_bus() as theirs, theirs.subscribe(str(COLOR), QUEUE(9)) as arrived:

        async def life() -> None:
            before = arrived.counts.received
            shaping = Shaping(ShapingSettings(uplink_mbit=1), Consumers("r1", "here", near=True))
            async with (
                network.open_bus() as ours,
                ours.publisher(str(COLOR), kind_of(COLOR).qos) as publisher,
                asyncio.TaskGroup() as group,
            ):
                with shaping.output(COLOR, publisher) as output:
                    running = group.create_task(shaping.run(ours))
                    output.put(numbered(0))
                    while arrived.counts.received == before:  # noqa: ASYNC110 - each turn of the loop is a suspension
                        await asyncio.sleep(0)
                    running.cancel()

        assert await cancel_everywhere(life) > 3
