"""Requests that a gateway answers: its clock, and calls of the ROS services that its settings allow."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Final

from bus import Bus, Handler, RefusedError, Reply, Request
from bus.clocks import clock_id
from gateway.ros1.errors import MessageError, Ros1Error
from gateway.ros1.node import Node
from gateway.ros1.sim_clock import SimClock
from gateway.ros1.tcpros.service_client import (
    ALL,
    ServiceAnswer,
    ServiceClient,
    deserialise_response,
    serialise_request,
)
from gateway.ros1.wire.tcpros import ANY, TopicType
from gateway.settings import GatewaySettings
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.ros import MAX_ANSWER_TEXT, ServiceRequest, ServiceResponse
from schemas.status import ClockReading


def clock_handler(robot: str, boot_id: str, ros_ns: Callable[[], int | None]) -> Handler:
    """Return the handler of clock requests; `ros_ns` returns ROS time if it is not the system's."""
    name = clock_id()

    async def answer(request: Request) -> Reply:
        reading = ClockReading(
            robot=robot,
            boot_id=boot_id,
            clock_id=name,
            received_ns=request.received_ns,
            sent_ns=time.time_ns(),
            ros_ns=ros_ns(),
        )
        return Reply(codec.encode(reading), codec.encoding(ClockReading))

    return answer


def request_for(kind: TopicType, asked: ServiceRequest) -> bytes:
    """Return the serialised request for a service of the type that it reports.

    Raises:
        MessageError: the request does not fit the type.
    """
    if asked.data is not None:
        return asked.data
    if kind in ALL:
        return serialise_request(kind, argument=asked.argument)
    raise MessageError(f"a {kind.name} [{kind.md5sum}] needs its request serialised, as data")


def response_of(answer: ServiceAnswer) -> ServiceResponse:
    """Return a service's response as a message.

    Raises:
        MessageError: it is not what its type says.
    """
    said = deserialise_response(answer.type, answer.data) if answer.type in ALL else None
    return ServiceResponse(
        type=answer.type.name,
        md5=answer.type.md5sum,
        success=said.success if said else None,
        message=said.message[:MAX_ANSWER_TEXT] if said else None,
        data=memoryview(answer.data),
    )


log = logging.getLogger(__name__)

WAITING: Final = 8
"""Most calls of one service that wait for the current one."""

UNLISTED: Final = 8
"""Requests for unlisted services that are refused at a time."""


@dataclass(slots=True)
class _Line:
    """The queue of one service."""

    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    length: int = 0


class ServiceCalls:
    """Calls each listed service for one request at a time.

    listed: the type that a service must have by its name, `*` for any.
    """

    def __init__(self, robot: str, listed: Mapping[str, str], client: ServiceClient) -> None:
        self._robot = robot
        self._listed = listed
        self._client = client
        self._lines = {service: _Line() for service in listed}

    @property
    def at_once(self) -> int:
        """The number of requests handled at once."""
        return len(self._listed) * (1 + WAITING) + UNLISTED

    async def __call__(self, request: Request) -> Reply:
        """Answer a request.

        Raises:
            RefusedError: no such request, a service that is not listed or busy, or the call did not succeed.
        """
        try:
            _, service = keys.parse_service(request.key)
            asked = codec.decode(ServiceRequest, request.payload, request.encoding)
        except SchemaError as error:
            raise RefusedError(str(error)) from error
        if service not in self._listed:
            raise RefusedError(
                f"{service} is not among the services that {self._robot}'s gateway may call (--services)"
            )
        line = self._lines[service]
        if line.length > WAITING:
            raise RefusedError(f"{service} is busy: {line.length} calls are under way already")
        line.length += 1
        try:
            async with line.turn:
                return await self._call(service, asked)
        finally:
            line.length -= 1

    async def _call(self, service: str, asked: ServiceRequest) -> Reply:
        wanted = self._listed[service]
        if wanted != ANY and asked.type not in ("", wanted):
            raise RefusedError(f"{service} is listed as {wanted}, not as {asked.type}")
        expected = TopicType(wanted if wanted != ANY else asked.type or ANY, asked.md5 or ANY)
        try:
            answer = await self._client.call(
                service, expected, lambda found: request_for(found, asked), timeout_s=asked.timeout_s
            )
            response = response_of(answer)
        except (Ros1Error, SchemaError) as error:
            log.warning("%s: a call for the fleet failed: %s", service, error)
            raise RefusedError(str(error)) from error
        log.debug("%s was called for the fleet", service)
        return Reply(codec.encode(response), codec.encoding(ServiceResponse))


@asynccontextmanager
async def answering(
    bus: Bus, node: Node, settings: GatewaySettings, boot_id: str, clock: SimClock
) -> AsyncIterator[None]:
    """Answer requests for the robot's clock and for its services while the context lasts."""
    client = ServiceClient(node.master)
    calls = ServiceCalls(settings.robot, settings.listed_services(), client)
    async with (
        bus.serve(
            keys.robot_clock(settings.robot),
            clock_handler(settings.robot, boot_id, lambda: clock.ros_time_ns),
            waiting=64,
        ),
        bus.serve(keys.every_service(settings.robot), calls, at_once=calls.at_once, waiting=0),
    ):
        yield
