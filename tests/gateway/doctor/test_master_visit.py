"""The doctor's look at a robot's ROS master: there, absent, hanging, or something else at its port."""

import asyncio
from typing import Any

import pytest

from gateway.doctor.evidence import Failure, MasterLook
from gateway.doctor.robot import PoliteClient, RobotVisit
from gateway.ros1.node import Node
from gateway.ros1.xmlrpc.server import XmlRpcServer
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.fakes import FakeSlave
from tests.integration.peers.ros import free_port


def visit(client: PoliteClient) -> RobotVisit:
    return RobotVisit(client, seconds=0.5, patience_s=client._timeout)


async def test_a_master_on_this_machine(client: PoliteClient, master: RosMaster) -> None:
    seen = await visit(client).look_at_master(master.uri)
    assert (seen.uri, seen.trouble, seen.remote, seen.sim_time) == (master.uri, None, False, False)


async def test_simulated_time(client: PoliteClient, master: RosMaster) -> None:
    await client.call(master.uri, "setParam", "/test", "/use_sim_time", True)  # noqa: FBT003 - as XML-RPC has it
    assert (await visit(client).look_at_master(master.uri)).sim_time


async def failed(client: PoliteClient, uri: str) -> MasterLook:
    seen = await visit(client).look_at_master(uri)
    assert seen.graph is None
    assert seen.trouble is not None
    return seen


async def test_no_master_there(client: PoliteClient) -> None:
    seen = await failed(client, f"http://localhost:{free_port()}")
    assert seen.trouble
    assert seen.trouble.failure is Failure.DEAD


@pytest.mark.parametrize("patience_s", [0.3])
async def test_a_master_that_hangs(client: PoliteClient) -> None:
    async def hang(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while await reader.read(4096):
            pass
        writer.close()

    async with await asyncio.start_server(hang, "127.0.0.1", 0) as server:
        seen = await failed(client, f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}")
    assert seen.trouble
    assert seen.trouble.failure is Failure.SILENT


@pytest.mark.parametrize("answer", [0, [["/chat"]], "text"])
async def test_something_else_at_the_masters_port(client: PoliteClient, answer: Any) -> None:
    async with XmlRpcServer(FakeSlave(lambda _method, _params: answer), host="127.0.0.1") as server:
        seen = await failed(client, server.uri)
    assert seen.trouble
    assert seen.trouble.failure is Failure.FOREIGN


async def test_a_node_at_the_masters_port(client: PoliteClient, master: RosMaster) -> None:
    async with Node("/talker", master_uri=master.uri) as node:
        seen = await failed(client, node.uri)
    assert seen.trouble
    assert seen.trouble.failure is Failure.REFUSED
