"""Serves page and API on the monitor's own event loop."""

import asyncio
import contextlib
import socket
import ssl
from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import uvicorn
from fastapi.middleware.gzip import GZipMiddleware
from nicegui import ui
from uvicorn.config import Config
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState

from services.monitor.monitor import Monitor
from services.monitor.web.application import guarded, make_application
from services.monitor.web.auth.logins import Access
from services.monitor.web.connections import KNOWN, Acceptor, Connection
from services.monitor.web.pages import add_pages

HEAD_S: Final = 10.0
"""Seconds allowed for a request's head, counted from the connection's start for the first one."""

MAX_HEAD_BYTES: Final = 64 * 1024


class BoundedProtocol(HttpToolsProtocol, Connection):
    """Closes connections whose head is too slow or too long; its connection is a stranger's until told otherwise."""

    def __init__(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
        *,
        head_s: float = HEAD_S,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._head_s = head_s
        self._head_bytes = 0
        self._head_ends: asyncio.TimerHandle | None = None
        self.opened_s = self.loop.time()
        self.is_stranger = True

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the timeout of the first head."""
        super().connection_made(transport)
        self._begin_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timeout."""
        self._end_head()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Pass on data, unless its head has become too long."""
        super().data_received(data)
        if self._head_ends is not None:
            self._head_bytes += len(data)
            if self._head_bytes > MAX_HEAD_BYTES:
                self.transport.abort()

    def on_message_begin(self) -> None:
        """Start the timeout of a further head."""
        super().on_message_begin()
        self.scope[KNOWN] = self._become_known  # type: ignore[typeddict-unknown-key]
        if self._head_ends is None:
            self._begin_head()

    def on_headers_complete(self) -> None:
        """End the timeout of the head."""
        self._end_head()
        super().on_headers_complete()

    def _become_known(self) -> None:
        self.is_stranger = False

    def _begin_head(self) -> None:
        self._head_bytes = 0
        self._head_ends = self.loop.call_later(self._head_s, self.transport.abort)

    def _end_head(self) -> None:
        if self._head_ends is not None:
            self._head_ends.cancel()
            self._head_ends = None


class SocketProtocol(WebSocketsSansIOProtocol):
    """WebSockets whose refusal with a response is no error: uvicorn (0.54) logs that nothing was answered."""

    async def send(self, message: Any) -> None:
        """Send an application's message."""
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and not message.get("more_body", False):
            self.handshake_complete = True


STOP_S: Final = 1
"""Seconds allowed for requests and browsers to finish when the monitor stops."""

MAX_FRAME_BYTES: Final = 256 * 1024
"""Limit of a browser's WebSocket message."""

GZIP_LEVEL: Final = 1
"""Compression happens on the event loop: the usual level 9 takes four times as long for a tenth less."""

LANGUAGE: Final = "en-US"

ICON: Final = "👁"


class _Server(uvicorn.Server):
    """Accepts connections by itself, so that all are bounded, and leaves signals to its process."""

    def __init__(self, config: Config, listener: socket.socket, most: int, tls: ssl.SSLContext | None) -> None:
        super().__init__(config)
        self._listener = listener
        self._acceptor = Acceptor(self.server_state, self._protocol, most, tls)

    async def main_loop(self) -> None:
        """Accept connections until it is to end."""
        async with asyncio.TaskGroup() as group:
            accepting = group.create_task(self._acceptor.run(self._listener))
            await super().main_loop()
            accepting.cancel()

    def _protocol(self) -> BoundedProtocol:
        return BoundedProtocol(self.config, self.server_state, self.lifespan.state)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture no signals."""
        yield


async def serve(
    monitor: Monitor,
    listener: socket.socket,
    access: Access,
    tls: ssl.SSLContext | None = None,
    machine_names: frozenset[str] = frozenset(),
) -> None:
    """Serve on a listening socket until cancelled, then close it.

    tls: over HTTPS with this context. machine_names: host names of this machine.
    """
    app = make_application(monitor, access)
    ui.run_with(
        app,
        title="fleetsight",
        favicon=ICON,
        dark=None,
        language=LANGUAGE,
        show_welcome_message=False,
        tailwind=False,
        gzip_middleware_factory=partial(GZipMiddleware, compresslevel=GZIP_LEVEL),
    )
    add_pages(app, monitor)
    settings = monitor.settings
    config = uvicorn.Config(
        guarded(app, access, settings, machine_names),
        log_config=None,
        log_level="warning",
        access_log=False,
        lifespan="on",
        limit_concurrency=settings.web_connections,
        proxy_headers=settings.web_url is not None,
        server_header=False,
        timeout_graceful_shutdown=STOP_S,
        ws=SocketProtocol,
        ws_max_size=MAX_FRAME_BYTES,
    )
    server = _Server(config, listener, settings.web_connections, tls)
    serving = asyncio.ensure_future(server.serve(sockets=[]))
    try:
        await asyncio.shield(serving)
    finally:
        server.should_exit = True
        await asyncio.wait([serving])
        listener.close()
