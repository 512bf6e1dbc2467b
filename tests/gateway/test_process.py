import asyncio
import os

import pytest

from bus import QUEUE, BusSettings, open_bus
from bus.reporting import VERSION
from gateway.process import run
from gateway.ros1.master import SystemState
from gateway.ros1.node import Node
from gateway.ros1.xmlrpc.client import XmlRpcClient
from gateway.settings import GatewaySettings
from schemas import codec, keys
from schemas.status import GatewayStatus
from services.simulator.ros_master.master import RosMaster
from services.toolbox.demo.children import free_ports
from tests.waiting import until


async def test_a_gateway_starts_without_its_master_says_so_and_goes_on_when_it_comes() -> None:
    port, endpoint = free_ports(1), f"tcp/127.0.0.1:{free_ports(1)}"
    settings = GatewaySettings(
        robot="r1",
        ros_master=f"http://127.0.0.1:{port}",
        ros_host="127.0.0.1",
        connect=[endpoint],
        cameras={"camera": "/camera/color/image_raw"},
    )
    async with open_bus(BusSettings(mode="router", listen=[endpoint])) as bus:
        before = os.sched_getscheduler(0)
        running = asyncio.create_task(run(settings))
        async with bus.subscribe(keys.gateway_status("r1"), QUEUE(9)) as statuses, asyncio.timeout(30):

            async def until_waiting_for(text: str) -> GatewayStatus:
                async for sample in statuses:
                    status = codec.decode(GatewayStatus, sample.payload, sample.encoding)
                    if status.waiting_for == text:
                        return status
                raise AssertionError("the bus was closed")

            waiting = await until_waiting_for(f"the ROS master at http://127.0.0.1:{port}")
            assert waiting.version == VERSION
            assert os.sched_getscheduler(0) == os.SCHED_BATCH
            assert [stream.topic for stream in waiting.streams] == ["/camera/color/image_raw"]
            assert [returned.topic for returned in waiting.returns] == [
                "/ultralytics/detection/classes",
                "/ultralytics/detection/distance",
                "/ultralytics/detection/image",
                "/ultralytics/segmentation/image",
                "/ultralytics/segmentation/points",
                "/ultralytics/alerts",
                "/fleetsight/obstacles",
                "/fleetsight/objects",
                "",
            ]
            async with RosMaster(port=port):
                assert (await until_waiting_for("")).boot_id == waiting.boot_id
        running.cancel()
        await asyncio.wait([running])
        assert os.sched_getscheduler(0) == before


async def test_a_gateway_that_nobody_can_reach_says_so_at_its_start(caplog: pytest.LogCaptureFixture) -> None:
    settings = GatewaySettings(
        robot="r1",
        ros_master=f"http://127.0.0.1:{free_ports(1)}",
        ros_host="192.0.2.1",
        connect=[f"tcp/127.0.0.1:{free_ports(1)}"],
    )
    running = asyncio.create_task(run(settings))
    await until(lambda: "--ros-host 192.0.2.1: is not an address of this machine" in caplog.text, "it is warned of")
    running.cancel()
    await asyncio.wait([running])


async def test_a_gateway_that_its_master_ends_says_so_with_its_exit_code() -> None:
    async with RosMaster() as master, Node("/other", master_uri=master.uri) as other:
        settings = GatewaySettings(
            robot="r1",
            ros_master=master.uri,
            ros_host="127.0.0.1",
            connect=[f"tcp/127.0.0.1:{free_ports(1)}"],
            cameras={"camera": "/camera/color/image_raw"},
        )
        running = asyncio.create_task(run(settings))
        async with asyncio.timeout(20), XmlRpcClient() as client:
            while not (nodes := gateways(await other.master.get_system_state())):  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.05)
            uri = await other.master.lookup_node(nodes.pop())
            await client.call(uri, "shutdown", "/other", "because")
            assert await running != 0


def gateways(state: SystemState) -> set[str]:
    names = {name for members in (state.publishers, state.subscribers) for nodes in members.values() for name in nodes}
    return {name for name in names if name.startswith("/fleetsight_gateway_")}
