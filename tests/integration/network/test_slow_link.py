"""Small messages on a real Zenoh link that images fill: they wait for little of what was sent before them."""

import asyncio
import os
import statistics

from bus import QUEUE, BusSettings, QoS, open_bus
from bus.session.tcp_options import UNSENT_BYTES
from services.toolbox.demo.children import free_ports
from tests.integration.network.thin_link import thin_link
from tests.waiting import until

LINK_BYTES_PER_S = 1_000_000
IMAGE = os.urandom(200_000)
ROUNDS = 20


async def test_a_small_message_waits_for_what_is_on_its_way_and_not_for_all_that_a_socket_takes() -> None:
    port = free_ports(1)
    router_settings = BusSettings(mode="router", listen=[f"tcp/127.0.0.1:{port}"], shared_memory=False)
    async with (
        open_bus(router_settings) as router,
        thin_link(port, LINK_BYTES_PER_S) as (link, through),
        open_bus(BusSettings(connect=[f"tcp/127.0.0.1:{through}"], shared_memory=False)) as robot,
        router.subscribe("image", QUEUE(1), history=False),
        router.subscribe("small", QUEUE(ROUNDS), history=False) as arrived,
        robot.publisher("image", QoS.IMAGE) as images,
        robot.publisher("small", QoS.RESULT) as small,
    ):
        await until(lambda: images.wanted and small.wanted, "both are wanted")
        ahead = []
        for number in range(ROUNDS):
            for _ in range(10):
                images.put(IMAGE)
                await asyncio.sleep(0.01)
            before = link.passed
            small.put(b"%d" % number)
            async with asyncio.timeout(20):
                assert (await anext(arrived)).payload == b"%d" % number
            ahead.append(link.passed - before)
    assert link.passed > ROUNDS * 50_000, "the images filled the link"
    assert statistics.median(ahead) < 3 * UNSENT_BYTES, "without a bound it is all that both ends' sockets hold"


async def test_small_messages_of_a_topic_pass_a_link_that_images_fill() -> None:
    port = free_ports(1)
    router_settings = BusSettings(mode="router", listen=[f"tcp/127.0.0.1:{port}"], shared_memory=False)
    async with (
        open_bus(router_settings) as router,
        thin_link(port, LINK_BYTES_PER_S) as (_, through),
        open_bus(BusSettings(connect=[f"tcp/127.0.0.1:{through}"], shared_memory=False)) as robot,
        router.subscribe("image", QUEUE(1), history=False),
        router.subscribe("message", QUEUE(ROUNDS * 10), history=False) as arrived,
        robot.publisher("image", QoS.IMAGE) as images,
        robot.publisher("message", QoS.MESSAGE) as messages,
    ):
        await until(lambda: images.wanted and messages.wanted, "both are wanted")
        sent = [b"%d" % number for number in range(ROUNDS * 10)]
        for number in range(ROUNDS):
            for payload in sent[number * 10 : (number + 1) * 10]:
                images.put(IMAGE)
                messages.put(payload)
            await asyncio.sleep(0.05)
        async with asyncio.timeout(20):
            assert [(await anext(arrived)).payload for _ in sent] == sent
    assert images.counts.dropped > 0, "the images filled the link"
