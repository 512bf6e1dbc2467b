"""Accepts connections, and loses none: a task that is cancelled while it accepts may hold one already."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable

log = logging.getLogger(__name__)
_RETRY_S: Final = 0.5


class Acceptor:
    """Hands over each connection, which is not blocking, with its peer's address, from now on until it is closed."""

    def __init__(self, listener: socket.socket, on_connection: Callable[[socket.socket, str], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._on_connection = on_connection
        self._retry: asyncio.TimerHandle | None = None
        self._begin()

    def close(self) -> None:
        """Accept nothing more and close the listener; may be called again."""
        if self._retry is not None:
            self._retry.cancel()
        if self._listener.fileno() >= 0:
            self._loop.remove_reader(self._listener)
            self._listener.close()

    def _begin(self) -> None:
        self._loop.add_reader(self._listener, self._accept)

    def _accept(self) -> None:
        try:
            connection, peer = self._listener.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):  # whoever it was has left
            return
        except OSError as error:
            log.warning("no connection can be accepted: %s", error)
            self._loop.remove_reader(self._listener)
            self._retry = self._loop.call_later(_RETRY_S, self._begin)
            return
        connection.settimeout(0)
        self._on_connection(connection, peer[0])
