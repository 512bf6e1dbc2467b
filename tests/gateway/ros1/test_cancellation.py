"""Cancelled at any await, nothing is left: no task, no socket, no registration."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from gateway.ros1.node import Node
from gateway.ros1.rosmaster import RosMaster
from tests.gateway.ros1.cancelling import cancel_everywhere, open_sockets
from tests.gateway.ros1.waiting import until

if TYPE_CHECKING:
    from gateway.ros1.subscriber import Message

STRING = "std_msgs/String"


async def test_node_with_a_subscription_and_a_publication() -> None:
    async with RosMaster() as master, Node("/watch", master_uri=master.uri) as watch:
        await watch.master.get_pid()
        tasks, sockets = asyncio.all_tasks(), open_sockets()

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

        async def nothing_is_left(n: int) -> None:
            state = await watch.master.get_system_state()
            assert (state.publishers, state.subscribers) == ({}, {}), n
            await until(lambda: asyncio.all_tasks() <= tasks, f"no task is left after {n}")
            await until(lambda: open_sockets() <= sockets, f"no socket is left after {n}")

        assert await cancel_everywhere(life, nothing_is_left) > 20


async def test_master() -> None:
    tasks, sockets = asyncio.all_tasks(), open_sockets()

    async def life() -> None:
        async with RosMaster() as master, Node("/a", master_uri=master.uri) as node:
            await node.master.register_subscriber("/chat", STRING, node.uri)
            await node.master.register_publisher("/chat", STRING, node.uri)

    async def nothing_is_left(n: int) -> None:
        await until(lambda: asyncio.all_tasks() <= tasks, f"no task is left after {n}")
        await until(lambda: open_sockets() <= sockets, f"no socket is left after {n}")

    assert await cancel_everywhere(life, nothing_is_left) > 5
