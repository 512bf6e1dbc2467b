"""The command against a server of the test's own; against a gateway and rospy in tests/integration/ros_graph."""

import asyncio

import pytest

from bus import BusSettings, Handler, RefusedError, Reply, Request, open_bus
from schemas import codec, keys
from schemas.ros import ServiceRequest, ServiceResponse
from services.toolbox.call.process import run
from services.toolbox.call.settings import CallSettings
from services.toolbox.demo.children import free_ports


def answered(*, success: bool, message: str) -> Reply:
    response = ServiceResponse(
        type="std_srvs/SetBool", md5="0" * 32, success=success, message=message, data=memoryview(b"")
    )
    return Reply(codec.encode(response), codec.encoding(ServiceResponse))


async def call(server: Handler, **settings: object) -> int:
    """Run the command against a server until it says something else than that there is none yet."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with (
        open_bus(BusSettings(mode="router", listen=[endpoint])) as bus,
        bus.serve(keys.every_service("r1"), server),
        asyncio.timeout(20),
    ):
        return await run(
            CallSettings.model_validate({"robot": "r1", "service": "/brake", "connect": [endpoint], **settings})
        )


@pytest.mark.parametrize(("data", "argument"), [("true", True), ("false", False), (None, None)])
async def test_it_asks_and_prints_the_answer(
    data: str | None, *, argument: bool | None, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[ServiceRequest] = []

    async def server(request: Request) -> Reply:
        asked.append(codec.decode(ServiceRequest, request.payload, request.encoding))
        return answered(success=True, message="braking" if argument else "")

    assert await call(server, data=data, timeout_s=7) == 0
    assert asked == [ServiceRequest(argument=argument, timeout_s=7)]
    assert capsys.readouterr() == ("braking\n" if argument else "done\n", "")


@pytest.mark.parametrize(("message", "reason"), [("too\nhot\x1b[2J", r"too hot\x1b[2J"), ("", "it gives no reason")])
async def test_a_service_that_does_not_succeed(message: str, reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    async def server(_: Request) -> Reply:
        return answered(success=False, message=message)

    assert await call(server) == 1
    assert capsys.readouterr() == ("", f"fleetsight call: /brake did not succeed: {reason}\n")


async def test_what_goes_wrong_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    async def refuse(_: Request) -> Reply:
        raise RefusedError("/brake is busy")

    async def babble(_: Request) -> Reply:
        return Reply(b"")

    assert await call(refuse) == 1
    assert capsys.readouterr().err == "fleetsight call: /brake is busy\n"
    assert await call(babble) == 1
    assert capsys.readouterr().err.startswith("fleetsight call: /brake of r1: encoded as")
    nowhere = f"tcp/127.0.0.1:{free_ports(1)}"
    assert await run(CallSettings(robot="r1", service="/brake", connect=[nowhere])) == 1
    assert capsys.readouterr().err == f"fleetsight call: /brake of r1: there is no router at {nowhere} yet\n"
