from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from gateway.ros1.errors import (
    InvalidNameError,
    LinkRefusedError,
    MessageError,
    ServiceFailedError,
    ServiceTimeoutError,
    TcprosError,
    TypeMismatchError,
    UnknownServiceError,
    UnreachableError,
)
from gateway.ros1.master import MasterClient
from gateway.ros1.tcpros.service_client import SET_BOOL, TRIGGER, ServiceAnswer, ServiceClient
from gateway.ros1.wire.header import encode_header
from gateway.ros1.wire.tcpros import TopicType
from gateway.ros1.xmlrpc.client import XmlRpcClient
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.cancelling import cancel_everywhere
from tests.gateway.ros1.support.services import answer, fake_service, service_header
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

ANY = TopicType("*", "*")
DONE = b"\1\4\0\0\0done"


@pytest.fixture
async def master() -> AsyncIterator[MasterClient]:
    async with RosMaster() as ros_master, XmlRpcClient() as client:
        yield MasterClient(client, uri=ros_master.uri, caller_id="/test")


def caller(master: MasterClient) -> ServiceClient:
    return ServiceClient(master, max_response_bytes=1000)


async def call(master: MasterClient, expected: TopicType = ANY, *, timeout_s: float = 20) -> ServiceAnswer:
    return await caller(master).call("/reset", expected, lambda _: b"request", timeout_s=timeout_s)


async def test_a_service_is_asked_and_answers(master: MasterClient) -> None:
    found: list[TopicType] = []

    def make(kind: TopicType) -> bytes:
        found.append(kind)
        return b"request"

    async with fake_service(master, "/reset", service_header(), answer(DONE), hang=True) as service:
        answered = await caller(master).call("/reset", ANY, make, timeout_s=20)
        assert answered == ServiceAnswer(TRIGGER, DONE)
        assert (found, service.requests) == ([TRIGGER], [b"request"])


async def test_an_empty_answer_is_one(master: MasterClient) -> None:
    async with fake_service(master, "/reset", service_header(), answer(b"")):
        assert (await call(master)).data == b""


async def test_what_the_master_does_not_know(master: MasterClient) -> None:
    with pytest.raises(UnknownServiceError, match="the ROS master knows no service /reset"):
        await call(master)
    with pytest.raises(InvalidNameError):
        await caller(master).call("reset", ANY, lambda _: b"", timeout_s=1)


async def test_a_service_that_fails_says_why(master: MasterClient) -> None:
    async with fake_service(master, "/reset", service_header(), answer(b"too hot", ok=False)):
        with pytest.raises(ServiceFailedError, match="/reset failed: too hot"):
            await call(master)
    async with fake_service(master, "/reset", service_header(), answer(b"", ok=False)):
        with pytest.raises(ServiceFailedError, match="it does not say why"):
            await call(master)


async def test_a_service_of_another_type_is_not_asked(master: MasterClient) -> None:
    async with fake_service(master, "/reset", service_header(), answer(DONE)) as service:
        with pytest.raises(TypeMismatchError, match="expected std_srvs/SetBool"):
            await call(master, SET_BOOL)
        assert service.requests == []


async def test_a_request_that_cannot_be_made_is_not_sent(master: MasterClient) -> None:
    def refuse(kind: TopicType) -> bytes:
        raise MessageError(kind.name)

    async with fake_service(master, "/reset", service_header(), answer(DONE)) as service:
        with pytest.raises(MessageError, match="std_srvs/Trigger"):
            await caller(master).call("/reset", ANY, refuse, timeout_s=20)
        assert service.requests == []


async def test_what_is_no_service(master: MasterClient) -> None:
    async with fake_service(master, "/reset", encode_header({"error": "go away"})):
        with pytest.raises(LinkRefusedError, match="go away"):
            await call(master)
    async with fake_service(master, "/reset", b"HTTP/1.1 400 Bad Request\r\n"):
        with pytest.raises(TcprosError, match="over the limit"):
            await call(master)
    async with fake_service(master, "/reset", service_header(), answer(bytes(1001))):
        with pytest.raises(TcprosError, match="frame of 1001 bytes"):
            await call(master)


async def test_a_service_that_closes_the_connection(master: MasterClient) -> None:
    async with fake_service(master, "/reset", service_header(), b"\1\4\0\0\0x"):
        with pytest.raises(UnreachableError, match="/reset closed the connection without an answer"):
            await call(master)


@pytest.mark.parametrize("host", ["robot..lan", "x" * 64])
async def test_a_service_at_a_host_that_cannot_be_one(master: MasterClient, host: str) -> None:
    await master.call("registerService", "/reset", f"rosrpc://{host}:4000", "http://127.0.0.1:1/")
    with pytest.raises(UnreachableError, match="/reset cannot be reached"):
        await call(master)


async def test_a_service_that_was_killed_stays_registered(master: MasterClient) -> None:
    await master.call("registerService", "/reset", "rosrpc://127.0.0.1:9", "http://127.0.0.1:1/")
    with pytest.raises(UnreachableError, match="/reset cannot be reached"):
        await call(master)
    await master.call("registerService", "/reset", "rosrpc://nowhere", "http://127.0.0.1:1/")
    with pytest.raises(UnreachableError, match="is not a service's address"):
        await call(master)


@pytest.mark.parametrize(("header", "answered"), [(b"", b""), (service_header(), b""), (service_header(), b"\1\4\0")])
async def test_a_service_that_hangs(master: MasterClient, header: bytes, answered: bytes) -> None:
    async with fake_service(master, "/reset", header, answered, hang=True):
        with pytest.raises(ServiceTimeoutError, match=r"/reset did not answer within 0\.2 s"):
            await call(master, timeout_s=0.2)


async def test_a_master_that_is_away() -> None:
    async with XmlRpcClient() as client:
        gone = MasterClient(client, uri="http://127.0.0.1:9", caller_id="/test")
        with pytest.raises(UnreachableError, match="lookupService"):
            await call(gone)


async def test_cancelled_anywhere_it_leaves_nothing(master: MasterClient) -> None:
    async with fake_service(master, "/reset", service_header(), answer(DONE), hang=True) as service:
        await call(master)
        await until(lambda: service.connections == 1, "the service has seen the call")

        async def life() -> None:
            assert (await call(master)).data == DONE

        assert await cancel_everywhere(life, sockets=True) > 5
