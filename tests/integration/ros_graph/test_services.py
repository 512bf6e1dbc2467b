"""ROS services of real rospy nodes, called through a gateway from the other end of the bus."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from bus import Bus, NotServedError, RefusedError
from gateway.ros1.tcpros.service_client import ALL
from schemas import codec, keys
from schemas.ros import ServiceRequest, ServiceResponse
from schemas.status import ClockReading
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig
from tests.integration.peers.ros import real_master, require_ros

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from tests.integration.peers.ros import RosEnvironment, RosProcess

ROOT: Final = Path(__file__).parents[3]
LISTED: Final = "/reset,/brake,/empty,/fails,/raises,/hangs,/loggers=roscpp/GetLoggers,/gone"
GET_LOGGERS_MD5: Final = "32e97e85527d4678a8f9279894bb64b0"

SERVICES: Final = """
import rospy
from roscpp.msg import Logger
from roscpp.srv import GetLoggers, GetLoggersResponse
from std_srvs.srv import Empty, EmptyResponse, SetBool, SetBoolResponse, Trigger, TriggerResponse
rospy.init_node("motor")

def fail(_):
    raise ValueError("on purpose")

def hang(_):
    rospy.sleep(60)
    return TriggerResponse()

def loggers(_):
    return GetLoggersResponse([Logger("rosout", "info")])

rospy.Service("/reset", Trigger, lambda _: TriggerResponse(True, "was reset"))
rospy.Service("/brake", SetBool, lambda request: SetBoolResponse(request.data, "braking" if request.data else "free"))
rospy.Service("/empty", Empty, lambda _: EmptyResponse())
rospy.Service("/fails", Trigger, lambda _: TriggerResponse(False, "too hot"))
rospy.Service("/raises", Trigger, fail)
rospy.Service("/hangs", Trigger, hang)
rospy.Service("/loggers", GetLoggers, loggers)
rospy.Service("/unlisted", Trigger, lambda _: TriggerResponse(True, ""))
print("services up", flush=True)
rospy.spin()
"""

TYPES: Final = """
from std_srvs.srv import Empty, SetBool, Trigger
for kind in (Empty, Trigger, SetBool):
    print("type", kind._type, kind._md5sum, flush=True)
"""

GONE: Final = """
import rospy
from std_srvs.srv import Trigger, TriggerResponse
rospy.init_node("gone")
rospy.Service("/gone", Trigger, lambda _: rospy.sleep(60))
print("service up", flush=True)
rospy.spin()
"""


@pytest.fixture
async def ros(tmp_path: Path) -> AsyncIterator[RosEnvironment]:
    require_ros("std_srvs", "roscpp")
    async with real_master(tmp_path) as environment:
        yield environment


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def up(ros: RosEnvironment, rig: FleetRig) -> None:
    services = await ros.script(SERVICES)
    await services.until_output("services up")
    await rig.gateway("r1", ros.master_uri, {"front": "/front/color/image_raw"}, "--services", LISTED)
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                await rig.bus.request(keys.robot_clock("r1"), timeout_s=PATIENCE_S)
            except NotServedError:
                await asyncio.sleep(0.05)
            else:
                return


async def ask(bus: Bus, service: str, request: ServiceRequest | None = None) -> ServiceResponse:
    payload = codec.encode(request or ServiceRequest(timeout_s=10))
    reply = await bus.request(
        keys.service("r1", service), payload, encoding=codec.encoding(ServiceRequest), timeout_s=PATIENCE_S
    )
    return codec.decode(ServiceResponse, reply.payload, reply.encoding)


async def refusal(bus: Bus, service: str, request: ServiceRequest | None = None) -> str:
    with pytest.raises(RefusedError) as caught:
        await ask(bus, service, request)
    return str(caught.value)


@pytest.mark.timeout(120)
async def test_services_answer_or_say_why_not(ros: RosEnvironment, rig: FleetRig) -> None:
    await up(ros, rig)
    assert (await ask(rig.bus, "/reset")).message == "was reset"
    for argument, message in ((True, "braking"), (False, "free")):
        braked = await ask(rig.bus, "/brake", ServiceRequest(argument=argument, timeout_s=10))
        assert (braked.success, braked.message) == (argument, message)
    assert bytes((await ask(rig.bus, "/empty")).data) == b""
    assert (await ask(rig.bus, "/fails")).success is False
    assert "/raises failed: error processing request: on purpose" in await refusal(rig.bus, "/raises")
    assert "/hangs did not answer within 0.5 s" in await refusal(rig.bus, "/hangs", ServiceRequest(timeout_s=0.5))
    assert "/unlisted is not among the services that r1's gateway may call" in await refusal(rig.bus, "/unlisted")
    assert "the ROS master knows no service /gone" in await refusal(rig.bus, "/gone")
    wrong = ServiceRequest(type="std_srvs/SetBool", timeout_s=10)
    assert "/reset is std_srvs/Trigger" in await refusal(rig.bus, "/reset", wrong)


@pytest.mark.timeout(120)
async def test_a_service_of_any_type_takes_and_gives_bytes(ros: RosEnvironment, rig: FleetRig) -> None:
    await up(ros, rig)
    for md5 in ("", GET_LOGGERS_MD5):
        answered = await ask(rig.bus, "/loggers", ServiceRequest(md5=md5, data=b"", timeout_s=10))
        assert (answered.type, answered.md5) == ("roscpp/GetLoggers", GET_LOGGERS_MD5)
        assert bytes(answered.data) == b"\1\0\0\0\6\0\0\0rosout\4\0\0\0info"
    another = ServiceRequest(md5="0" * 32, data=b"", timeout_s=10)
    assert "md5sums do not match" in await refusal(rig.bus, "/loggers", another)
    types = await (await ros.script(TYPES)).finished()
    assert types.splitlines() == [f"type {kind.name} {kind.md5sum}" for kind in ALL]


@pytest.mark.timeout(120)
async def test_a_service_that_is_killed(ros: RosEnvironment, rig: FleetRig) -> None:
    await up(ros, rig)
    gone: RosProcess = await ros.script(GONE)
    await gone.until_output("service up")
    asking = asyncio.create_task(refusal(rig.bus, "/gone", ServiceRequest(timeout_s=20)))
    await asyncio.sleep(0.5)
    gone.kill()
    assert "/gone" in await asking
    assert "/gone cannot be reached" in await refusal(rig.bus, "/gone")


@pytest.mark.timeout(120)
async def test_people_call_services_from_the_command_line(ros: RosEnvironment, rig: FleetRig) -> None:
    await up(ros, rig)

    async def call(*arguments: str) -> tuple[int | None, str, str]:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "services.toolbox", "call", "r1", *arguments, "--connect", rig.endpoint),
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        out, errors = await process.communicate()
        return process.returncode, out.decode(), errors.decode()

    assert await call("/reset") == (0, "was reset\n", "")
    assert await call("/brake", "--data", "true") == (0, "braking\n", "")
    assert await call("/empty") == (0, "done\n", "")
    assert await call("/fails") == (1, "", "fleetsight call: /fails did not succeed: too hot\n")
    status, out, error = await call("/unlisted")
    assert (status, out) == (1, "")
    assert error.count("\n") == 1
    assert "/unlisted is not among the services" in error


@pytest.mark.timeout(120)
async def test_a_gateways_clock_is_that_of_its_machine(ros: RosEnvironment, rig: FleetRig) -> None:
    await up(ros, rig)
    reply = await rig.bus.request(keys.robot_clock("r1"), timeout_s=PATIENCE_S)
    reading = codec.decode(ClockReading, reply.payload, reply.encoding)
    assert (reading.robot, reading.ros_ns) == ("r1", None)
    assert reading.received_ns <= reading.sent_ns
