"""A gateway's node at an embedded master that knows others which were killed."""

import logging

import pytest

from gateway.node_names import clear_predecessors, node_name
from gateway.ros1.master import MasterClient
from gateway.ros1.node import Node
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.ros1.xmlrpc.server import XmlRpcServer
from services.simulator.ros_master.master import RosMaster
from services.toolbox.demo.children import free_ports
from tests.gateway.ros1.support.fakes import FakeSlave
from tests.gateway.ros1.support.nodes import node

TOPIC, TYPE = "/front/color/image_raw", "sensor_msgs/Image"
OWN = f"/{node_name('r1', 'a' * 32)}"
DEAD = (f"/{node_name('r1', '0' * 32)}", f"/ns/{node_name('r1', '1' * 32)}")
OTHERS = ("/camera", f"/{node_name('r2', '0' * 32)}", "/fleetsight_gateway_r1")


async def register(master: RosMaster, *names: str) -> None:
    """Register nodes where nothing listens."""
    async with XmlRpcClient() as client:
        for name in names:
            api = MasterClient(client, uri=master.uri, caller_id=name)
            await api.register_subscriber(TOPIC, TYPE, f"http://127.0.0.1:{free_ports(1)}/")


async def test_the_robots_own_dead_gateways_are_unregistered_and_nobody_else(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "gateway.node_names")
    async with RosMaster() as master:
        await register(master, *DEAD, *OTHERS)
        async with node(OWN, master) as own, own.subscribe(TOPIC, TYPE, lambda _: None):
            await clear_predecessors(own, "r1")
            assert (await own.master.get_system_state()).nodes() - {OWN} == set(OTHERS)
    said = [message for message in caplog.messages if "killed" in message]
    assert said == [f"{name} was killed: it is unregistered from the ROS master" for name in DEAD]


async def test_one_that_lives_stays(caplog: pytest.LogCaptureFixture) -> None:
    async with (
        RosMaster() as master,
        node(DEAD[0], master) as living,
        living.advertise("/text", "std_msgs/String"),
        node(OWN, master) as own,
    ):
        async for look in own.looks():
            if DEAD[0] in look.state.nodes():
                break
        await clear_predecessors(own, "r1")
        assert (await own.master.get_system_state()).nodes() == {DEAD[0]}
    assert not caplog.messages


async def test_a_master_that_fails_halfway_is_no_gateways_end(caplog: pytest.LogCaptureFixture) -> None:
    def answer(method: str, _params: tuple[object, ...]) -> object:
        return [[[TOPIC, [DEAD[0]]]], [], []] if method == "getSystemState" else 5

    async with XmlRpcServer(FakeSlave(answer), host="127.0.0.1") as master, Node(OWN, master_uri=master.uri) as own:
        await clear_predecessors(own, "r1")
    assert caplog.messages == [f"{DEAD[0]} stays registered at the ROS master: str expected, not '5'"]
