"""Makes one call and prints its answer."""

import sys
from typing import Final

from bus import Bus, RefusedError, RequestError, open_bus
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.printing import printable
from schemas.ros import ServiceRequest, ServiceResponse
from services.toolbox.call.settings import CallSettings

FAILED: Final = 1
WAY_S: Final = 2.0
"""Seconds that an answer may take beyond the service's own timeout."""


async def run(settings: CallSettings) -> int:
    """Call the service; print its answer, or on stderr why it failed. Returns the exit code."""
    async with open_bus(settings) as bus:
        try:
            response = await _call(bus, settings)
        except RefusedError as error:  # in the gateway's words, which name the service
            return _fail(str(error))
        except (RequestError, SchemaError) as error:
            return _fail(f"{settings.service} of {settings.robot}: {error}")
    if response.success is False:
        return _fail(f"{settings.service} did not succeed: {response.message or 'it gives no reason'}")
    sys.stdout.write(f"{printable(response.message or 'done')}\n")
    return 0


async def _call(bus: Bus, settings: CallSettings) -> ServiceResponse:
    argument = None if settings.data is None else settings.data == "true"
    reply = await bus.request(
        keys.service(settings.robot, settings.service),
        codec.encode(ServiceRequest(argument=argument, timeout_s=settings.timeout_s)),
        encoding=codec.encoding(ServiceRequest),
        timeout_s=settings.timeout_s + WAY_S,
    )
    return codec.decode(ServiceResponse, reply.payload, reply.encoding)


def _fail(reason: str) -> int:
    sys.stderr.write(f"fleetsight call: {printable(' '.join(reason.split()))}\n")
    return FAILED
