"""Cancelled at any await, nothing is left: no task, no socket, no registration."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING

from gateway.ros1.node import Node
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.cancelling import cancel_everywhere, nothing_registered

if TYPE_CHECKING:
    from gateway.ros1.tcpros.subscriber import Message

STRING = "std_msgs/String"


async def test_node_with_a_subscription_and_a_publication() -> None:
    async with RosMaster() as master, Node("/watch", master_uri=master.uri) as watch:
        await watch.master.get_pid()

        async def life() -> None:
            got: list[Message] = []
            async with (
                Node("/a", master_uri=master.uri) as node,
                node.advertise("/chat", STRING, latch=True) as publication,
                node.subscribe("/chat", STRING, got.append),
            ):
                publication.publish(b"hello")
                # Every turn of the event loop is a suspension, so that the node's own tasks are cancelled at each too.
                while not got:  # noqa: ASYNC110
                    await asyncio.sleep(0)

        assert await cancel_everywhere(life, partial(nothing_registered, watch), sockets=True) > 20


async def test_master() -> None:
    async def life() -> None:
        async with RosMaster() as master, Node("/a", master_uri=master.uri) as node:
            await node.master.register_subscriber("/chat", STRING, node.uri)
            await node.master.register_publisher("/chat", STRING, node.uri)

    assert await cancel_everywhere(life, sockets=True) > 5
