"""A gateway that is asked over the bus, with a ROS master and services of the test's own."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from bus import Bus, RefusedError
from bus.fake import FakeNetwork
from gateway.requests import WAITING, answering
from gateway.ros1.node import Node
from gateway.ros1.sim_clock import SimClock
from gateway.ros1.tcpros.service_client import EMPTY, SET_BOOL, TRIGGER
from gateway.ros1.wire.tcpros import TopicType
from gateway.settings import GatewaySettings
from schemas import codec, keys
from schemas.ros import ServiceRequest, ServiceResponse
from schemas.status import ClockReading
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.services import answer, fake_service, service_header
from tests.waiting import until

DONE = answer(b"\1\4\0\0\0done")


@asynccontextmanager
async def asked(*services: str, clock: SimClock | None = None) -> AsyncIterator[tuple[Bus, Node]]:
    """A bus to ask on, and the node of the gateway there."""
    async with RosMaster() as master, Node("/gateway", master_uri=master.uri) as node:
        clock = clock or SimClock()
        settings = GatewaySettings(robot="r1", ros_master=master.uri, ros_host="127.0.0.1", services=list(services))
        async with FakeNetwork().open_bus() as bus, answering(bus, node, settings, "boot", clock):
            yield bus, node


async def call(bus: Bus, service: str, request: ServiceRequest) -> ServiceResponse:
    key, encoding = keys.service("r1", service), codec.encoding(ServiceRequest)
    reply = await bus.request(key, codec.encode(request), encoding=encoding, timeout_s=30)
    return codec.decode(ServiceResponse, reply.payload, reply.encoding)


async def refusal(bus: Bus, service: str, request: ServiceRequest | None = None) -> str:
    with pytest.raises(RefusedError) as caught:
        await call(bus, service, request or ServiceRequest(timeout_s=20))
    return str(caught.value)


async def test_the_clock() -> None:
    async with asked() as (bus, _):
        reply = await bus.request(keys.robot_clock("r1"), timeout_s=20)
        reading = codec.decode(ClockReading, reply.payload, reply.encoding)
        assert (reading.robot, reading.boot_id, reading.ros_ns) == ("r1", "boot", None)


async def test_the_clock_tells_ros_time_where_it_is_not_the_systems() -> None:
    clock = SimClock()
    clock.used = True
    clock.tell(5)
    async with asked(clock=clock) as (bus, _):
        reply = await bus.request(keys.robot_clock("r1"), timeout_s=20)
        assert codec.decode(ClockReading, reply.payload, reply.encoding).ros_ns == 5


async def test_services_of_std_srvs() -> None:
    async with asked("/empty", "/trigger", "/set=std_srvs/SetBool") as (bus, node):
        async with fake_service(node.master, "/empty", service_header(EMPTY), answer(b"")):
            assert (await call(bus, "/empty", ServiceRequest(timeout_s=20))).type == "std_srvs/Empty"
        async with fake_service(node.master, "/trigger", service_header(TRIGGER), DONE) as trigger:
            response = await call(bus, "/trigger", ServiceRequest(timeout_s=20))
            assert (response.success, response.message) == (True, "done")
            assert trigger.requests == [b""]
        async with fake_service(node.master, "/set", service_header(SET_BOOL), DONE) as setting:
            assert (await call(bus, "/set", ServiceRequest(argument=False, timeout_s=20))).success is True
            assert setting.requests == [b"\0"]
            assert "needs to be told true or false" in await refusal(bus, "/set")


async def test_a_service_of_any_type_takes_and_gives_bytes() -> None:
    kind = TopicType("maps/Get", "c" * 32)
    async with (
        asked("/map") as (bus, node),
        fake_service(node.master, "/map", service_header(kind), answer(b"map")) as service,
    ):
        response = await call(bus, "/map", ServiceRequest(type=kind.name, md5=kind.md5sum, data=b"\5", timeout_s=20))
        assert (response.type, response.md5, bytes(response.data)) == (kind.name, kind.md5sum, b"map")
        assert service.requests == [b"\5"]
        assert "maps/Get [cc" in await refusal(bus, "/map", ServiceRequest(md5="d" * 32, data=b"", timeout_s=20))
        assert "needs its request serialised" in await refusal(bus, "/map")
        assert service.requests == [b"\5"]


async def test_every_error_names_its_cause() -> None:
    async with asked("/reset", "/typed=std_srvs/Trigger") as (bus, node):
        assert await refusal(bus, "/other") == (
            "/other is not among the services that r1's gateway may call (--services)"
        )
        assert "the ROS master knows no service /reset" in await refusal(bus, "/reset")
        async with fake_service(node.master, "/reset", service_header(), answer(b"too hot", ok=False)):
            assert "/reset failed: too hot" in await refusal(bus, "/reset")
        async with fake_service(node.master, "/reset", service_header(), hang=True):
            error = await refusal(bus, "/reset", ServiceRequest(timeout_s=0.1))
            assert "/reset did not answer within 0.1 s" in error
        async with fake_service(node.master, "/reset", service_header(), answer(b"\1")):
            assert "1 bytes are not a std_srvs/TriggerResponse" in await refusal(bus, "/reset")
        asked_otherwise = ServiceRequest(type="std_srvs/Empty", timeout_s=20)
        assert "/typed is listed as std_srvs/Trigger, not as std_srvs/Empty" in await refusal(
            bus, "/typed", asked_otherwise
        )
        async with fake_service(node.master, "/typed", service_header(SET_BOOL), DONE) as changed:
            assert "/typed is std_srvs/SetBool" in await refusal(bus, "/typed")
            assert changed.requests == []
        with pytest.raises(RefusedError, match="encoded as"):
            await bus.request(keys.service("r1", "/reset"), b"", timeout_s=20)
        with pytest.raises(RefusedError, match="not a service's key"):
            await bus.request("fleet/r1/service", b"", timeout_s=20)


async def test_one_call_at_a_time_some_wait_and_the_rest_is_refused() -> None:
    async with (
        asked("/slow", "/quick") as (bus, node),
        fake_service(node.master, "/slow", service_header(), hang=True) as slow,
        fake_service(node.master, "/quick", service_header(), DONE),
    ):
        patient = ServiceRequest(timeout_s=50)
        waiting = [asyncio.create_task(call(bus, "/slow", patient)) for _ in range(1 + WAITING)]
        await until(lambda: len(slow.requests) == 1, "the first call has arrived")
        assert f"/slow is busy: {1 + WAITING} calls are under way already" in await refusal(bus, "/slow")
        assert (await call(bus, "/quick", ServiceRequest(timeout_s=20))).message == "done"
        assert slow.connections == 1
        waiting[0].cancel()
        for task in waiting[1:]:
            task.cancel()
        await asyncio.wait(waiting)


async def test_a_call_that_is_over_lets_the_next_one_in() -> None:
    async with (
        asked("/slow") as (bus, node),
        fake_service(node.master, "/slow", service_header(), hang=True) as slow,
    ):
        brief = ServiceRequest(timeout_s=0.1)
        errors = await asyncio.gather(*(refusal(bus, "/slow", brief) for _ in range(3)))
        assert all("did not answer within 0.1 s" in error for error in errors)
        assert slow.connections == 3
