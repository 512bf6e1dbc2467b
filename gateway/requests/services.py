"""Call the ROS services that the settings list for who asks on the bus."""

import asyncio
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from bus import RefusedError, Reply, Request
from gateway.requests.service_messages import request_for, response_of
from gateway.ros1.errors import Ros1Error
from gateway.ros1.service_client import ServiceClient
from gateway.ros1.wire.tcpros import ANY, TopicType
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.service import ServiceRequest, ServiceResponse

log = logging.getLogger(__name__)

WAITING: Final = 8
"""How many calls of one service wait for the one that is under way."""

UNLISTED: Final = 8
"""How many requests for services that are not listed are refused at once."""


@dataclass(slots=True)
class _Line:
    """Those who wait for one service."""

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
        """How many requests there is room for."""
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
            log.warning("%s was called for the fleet in vain: %s", service, error)
            raise RefusedError(str(error)) from error
        log.debug("%s was called for the fleet", service)
        return Reply(codec.encode(response), codec.encoding(ServiceResponse))
