"""Cancelled at any await, a gateway's stream leaves nothing: no task, socket, registration, declaration or token."""

import asyncio
from functools import partial

import pytest

from bus import QUEUE
from bus.fake import FakeNetwork
from gateway.discovery import DiscoverySettings, plan
from gateway.ros1.image import TYPE_NAME, Image, encode_image
from gateway.ros1.node import Node
from gateway.to_bus.forward import offering
from gateway.to_bus.shaping.consumers import Consumers
from gateway.to_bus.shaping.settings import ShapingSettings
from gateway.to_bus.shaping.shaping import Shaping
from gateway.to_bus.stream import StreamForward
from gateway.to_bus.subscriptions import Subscriptions
from gateway.to_bus.translators import kind_of
from schemas.keys import CameraKey, Stream, StreamKey
from services.simulator.ros_master.master import RosMaster
from tests.gateway.discovery.graphs import IMAGE, graph
from tests.gateway.offering import new_offers
from tests.gateway.ros1.support.cancelling import cancel_everywhere, nothing_registered

FRONT = CameraKey("r1", "front")
TOPIC = "/front/color/image_raw"


async def test_streams_that_come_and_go() -> None:
    network = FakeNetwork()
    planned = plan(graph({IMAGE: f"{TOPIC} /rear/image_raw"}), DiscoverySettings("r1"))
    async with (
        RosMaster() as master,
        Node("/watch", master_uri=master.uri) as watch,
        network.open_bus() as theirs,
        network.open_bus() as ours,
        theirs.watch("fleet/**/alive") as tokens,
    ):
        await watch.master.get_pid()

        async def life() -> None:
            async with Node("/gateway", master_uri=master.uri, exit_timeout=60) as node, asyncio.TaskGroup() as group:
                offers = new_offers(group, ours, node)
                await offers.change(planned)
                while not node.registered:  # noqa: ASYNC110 - each turn of the loop is a suspension
                    await asyncio.sleep(0)
                await offers.close()

        assert await cancel_everywhere(life, partial(nothing_registered, watch), sockets=True) > 10
        async with ours.announce(FRONT.alive(Stream.COLOR)):
            assert (await anext(tokens)).alive  # no token of a cancelled life is still there to be merged with


@pytest.mark.parametrize(
    ("latch", "settings"),
    [(False, {}), (True, {"compression": "raw"}), (True, {"compression": "png", "uplink_mbit": 1, "max_hz": "9"})],
)
async def test_a_wanted_stream(*, latch: bool, settings: dict[str, object]) -> None:
    network = FakeNetwork()
    async with (
        RosMaster() as master,
        Node("/watch", master_uri=master.uri) as watch,
        network.open_bus() as theirs,
        network.open_bus() as ours,
        theirs.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)),
        theirs.watch("fleet/*/*/color/alive") as tokens,
    ):
        await watch.master.get_pid()

        async def life() -> None:
            key = StreamKey(FRONT, Stream.COLOR)
            shaping = Shaping(ShapingSettings.model_validate(settings), Consumers("r1", "here", near=True))
            stream = StreamForward(key, TOPIC, kind_of(key), "boot", shaping.rate_limiter(key))
            async with (
                Node("/gateway", master_uri=master.uri, exit_timeout=60) as node,
                node.advertise(TOPIC, TYPE_NAME, latch=latch) as publication,
                offering(ours, stream, shaping.output) as forward,
                asyncio.TaskGroup() as group,
            ):
                running = [group.create_task(work) for work in (forward.run(Subscriptions(node)), shaping.run(ours))]
                publication.publish(encode_image(Image(0, 0, 0, "", 1, 1, "mono8", False, 1, memoryview(b"x"))))  # noqa: FBT003
                while not (forward.status().publishers and forward.status().bytes >= latch):  # noqa: ASYNC110
                    await asyncio.sleep(0)  # each turn of the loop is a suspension
                for task in running:
                    task.cancel()

        async def nothing_is_left(n: int) -> None:
            await nothing_registered(watch, n)
            async with theirs.subscribe(FRONT.stream(Stream.COLOR), QUEUE(9)) as late:
                assert late.counts.received == 0, n

        assert await cancel_everywhere(life, nothing_is_left, sockets=True) > 20
        async with ours.announce(FRONT.alive(Stream.COLOR)):
            assert (await anext(tokens)).alive  # no token of a cancelled life is still there to be merged with
