"""Accepts connections, for servers that bound them before anything is read."""

import asyncio
import logging
import socket
from collections.abc import AsyncIterator
from typing import Final

log = logging.getLogger(__name__)

RETRY_S: Final = 1.0
"""Pause after a connection that cannot be accepted, as with too many open files."""


async def accepted(listening: socket.socket) -> AsyncIterator[tuple[socket.socket, str]]:
    """Yield each connection of a non-blocking socket, and the address that it comes from, forever."""
    loop = asyncio.get_running_loop()
    while True:
        try:
            connected, (address, *_) = await loop.sock_accept(listening)
        except ConnectionError:  # it has gone again
            continue
        except OSError as error:
            log.warning("no connection can be accepted: %s", error.strerror)
            await asyncio.sleep(RETRY_S)
            continue
        yield connected, address
        await asyncio.sleep(0)  # where many wait to be accepted, nothing else would get its turn
