"""Nodes registered at an embedded master whose addresses refuse, answer, keep silent or have another node by now."""

from __future__ import annotations

import asyncio
import socket
from typing import TYPE_CHECKING

import pytest

from gateway.ros1.errors import UnreachableError
from gateway.ros1.master import MasterClient, SystemState
from gateway.ros1.stale_nodes import unregister_dead
from gateway.ros1.xmlrpc.client import XmlRpcClient
from services.toolbox.demo.children import free_ports
from tests.gateway.ros1.support.nodes import node

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from services.simulator.ros_master.master import RosMaster

PICTURES, SCANS = "/pictures", "/scans"
STRING = "std_msgs/String"


@pytest.fixture
async def client() -> AsyncIterator[XmlRpcClient]:
    async with XmlRpcClient(timeout=0.5) as client:
        yield client


def refusing() -> str:
    """Return the address of a node that was killed."""
    return f"http://127.0.0.1:{free_ports(1)}/"


async def registered(name: str, uri: str, master: RosMaster, client: XmlRpcClient) -> MasterClient:
    """Register a node for two topics; return the master as the node calls it."""
    api = MasterClient(client, uri=master.uri, caller_id=name)
    await api.register_publisher(PICTURES, STRING, uri)
    await api.register_subscriber(SCANS, STRING, uri)
    return api


async def test_a_node_that_was_killed_is_unregistered_and_nobody_else(master: RosMaster, client: XmlRpcClient) -> None:
    await registered("/other", refusing(), master, client)
    api = await registered("/killed", refusing(), master, client)
    state = await api.get_system_state()
    assert await unregister_dead("/killed", state, client=client, master_uri=master.uri)
    left = await api.get_system_state()
    assert (left.publishers, left.subscribers) == ({PICTURES: ("/other",)}, {SCANS: ("/other",)})
    assert not await unregister_dead("/killed", state, client=client, master_uri=master.uri)


async def test_who_listens_stays(master: RosMaster, client: XmlRpcClient) -> None:
    async with node("/alive", master) as alive:
        api = await registered("/alive", alive.uri, master, client)
        state = await api.get_system_state()
        assert not await alive.unregister_dead("/alive", state)
        assert await api.get_system_state() == state


async def test_who_keeps_silent_stays(master: RosMaster, client: XmlRpcClient) -> None:
    with socket.create_server(("127.0.0.1", 0)) as hung:
        api = await registered("/hung", f"http://127.0.0.1:{hung.getsockname()[1]}/", master, client)
        state = await api.get_system_state()
        assert not await unregister_dead("/hung", state, client=client, master_uri=master.uri)
        assert await api.get_system_state() == state


async def test_whose_address_may_be_on_another_machine_stays(master: RosMaster, client: XmlRpcClient) -> None:
    await registered("/other", refusing(), master, client)
    api = await registered("/elsewhere", refusing(), master, client)
    state = await api.get_system_state()
    far = master.uri.replace("127.0.0.1", "0.0.0.0")  # noqa: S104 - here too, but no loopback by its name
    assert not await unregister_dead("/elsewhere", state, client=client, master_uri=far)
    assert await api.get_system_state() == state


@pytest.mark.parametrize("uri", ["http://[::::]:4711/", "http://[abc:4711/", "http://robot:port/"])
async def test_who_registered_under_no_address_stays(master: RosMaster, client: XmlRpcClient, uri: str) -> None:
    api = await registered("/nowhere", uri, master, client)
    state = await api.get_system_state()
    assert not await unregister_dead("/nowhere", state, client=client, master_uri=master.uri)
    assert await api.get_system_state() == state


async def test_who_came_back_meanwhile_keeps_the_new_registrations(master: RosMaster, client: XmlRpcClient) -> None:
    api = await registered("/killed", refusing(), master, client)
    clearing = asyncio.create_task(
        unregister_dead("/killed", await api.get_system_state(), client=client, master_uri=master.uri)
    )
    while (await api.get_system_state()).publishers:  # noqa: ASYNC110 - it asks the master
        await asyncio.sleep(0)
    again = await registered("/killed", refusing(), master, client)
    await clearing
    assert (await again.get_system_state()).nodes() == {"/killed"}


async def test_a_master_that_is_gone_is_the_callers_trouble(client: XmlRpcClient) -> None:
    with pytest.raises(UnreachableError):
        await unregister_dead("/killed", SystemState({}, {}, {}), client=client, master_uri=refusing())
