from __future__ import annotations

import asyncio
from typing import Any

from gateway.ros1.tasks import TaskScope
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import XmlRpcServer
from services.simulator.ros_master.master import NodeNotifier
from tests.gateway.ros1.support.fakes import FakeSlave
from tests.waiting import until


async def test_newer_call_of_one_kind_replaces_an_older_that_still_waits() -> None:
    slave = FakeSlave(lambda _method, _params: 0)
    async with XmlRpcServer(slave, host="127.0.0.1") as server, XmlRpcClient() as client, TaskScope() as scope:
        notifier = NodeNotifier(client, scope)
        for i in range(3):
            notifier.notify(server.uri, "publisherUpdate", "/a", "/a", [str(i)])
            notifier.notify(server.uri, "publisherUpdate", "/b", "/b", [str(i)])
        await until(lambda: len(slave.calls) == 2, "both have come")
        await asyncio.sleep(0)
    assert slave.calls == [
        ("publisherUpdate", ("/master", "/a", ["2"])),
        ("publisherUpdate", ("/master", "/b", ["2"])),
    ]


async def test_hanging_node_delays_no_other() -> None:
    async def hang(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        hanging.append(writer)

    hanging: list[asyncio.StreamWriter] = []
    listener = await asyncio.start_server(hang, "127.0.0.1", 0)
    dead = f"http://127.0.0.1:{listener.sockets[0].getsockname()[1]}/"
    slave = FakeSlave(_zero)
    async with XmlRpcServer(slave, host="127.0.0.1") as server, XmlRpcClient() as client, TaskScope() as scope:
        notifier = NodeNotifier(client, scope)
        notifier.notify(dead, "publisherUpdate", "/a", "/a", [])
        await until(lambda: hanging, "the first call hangs")
        notifier.notify(server.uri, "publisherUpdate", "/a", "/a", [])
        await until(lambda: slave.calls, "the second call has come")
    listener.close()
    for writer in hanging:
        writer.transport.abort()


def _zero(_method: str, _params: tuple[Any, ...]) -> int:
    return 0
