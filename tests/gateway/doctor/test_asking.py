import asyncio
from typing import Any

import pytest

from gateway.doctor.robot import PoliteClient
from gateway.ros1.errors import StatusError, UnreachableError
from gateway.ros1.xmlrpc.server import XmlRpcServer
from tests.gateway.ros1.support.fakes import FakeSlave
from tests.integration.peers.ros import free_port


async def test_answers_come_as_ever() -> None:
    slave = FakeSlave(lambda method, _params: [method])
    async with XmlRpcServer(slave, host="127.0.0.1") as server, PoliteClient(timeout=5) as client:
        answers = await asyncio.gather(*(client.call(server.uri, f"m{n}", "/us") for n in range(20)))
    assert answers == [[f"m{n}"] for n in range(20)]


async def test_who_said_no_is_asked_again() -> None:
    def answer(_method: str, _params: tuple[Any, ...]) -> Any:
        raise StatusError(0, "no")

    slave = FakeSlave(answer)
    async with XmlRpcServer(slave, host="127.0.0.1") as server, PoliteClient(timeout=5) as client:
        for _ in range(2):
            with pytest.raises(StatusError):
                await client.call(server.uri, "getPid", "/us")
    assert len(slave.calls) == 2


async def test_who_was_silent_is_not_asked_again() -> None:
    uri = f"http://127.0.0.1:{free_port()}/"
    async with PoliteClient(timeout=5) as client:
        with pytest.raises(UnreachableError) as first:
            await client.call(uri, "getPid", "/us")
        with pytest.raises(UnreachableError) as second:
            await client.call(uri, "getPid", "/us")
    assert str(first.value) == str(second.value)
    assert type(first.value.__cause__) is type(second.value.__cause__)
