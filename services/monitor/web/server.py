"""Serve page and API from the monitor's own event loop."""

import asyncio
import contextlib
import socket
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
from services.monitor.page import add_pages
from services.monitor.web.application import guarded, make_application
from services.monitor.web.auth.logins import Access

HEAD_S: Final = 10.0
"""How long a request's head may take to arrive, counted from the connection's beginning for the first one."""

MAX_HEAD_BYTES: Final = 64 * 1024

TURNED_AWAY: Final = 50
"""Connections over the limit that are told so, with a 503; those over that are just closed."""


class BoundedProtocol(HttpToolsProtocol):
    """Closes connections whose head is too slow or too long, and those of which there are far too many."""

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

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first head."""
        super().connection_made(transport)
        if self.limit_concurrency is not None and len(self.connections) > self.limit_concurrency + TURNED_AWAY:
            transport.abort()
            return
        self._begin_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait for nothing more."""
        self._end_head()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take what came, unless the head that it belongs to has become too long."""
        super().data_received(data)
        if self._head_ends is not None:
            self._head_bytes += len(data)
            if self._head_bytes > MAX_HEAD_BYTES:
                self.transport.abort()

    def on_message_begin(self) -> None:
        """Wait for the rest of the head."""
        super().on_message_begin()
        if self._head_ends is None:
            self._begin_head()

    def on_headers_complete(self) -> None:
        """Go on to the body."""
        self._end_head()
        super().on_headers_complete()

    def _begin_head(self) -> None:
        self._head_bytes = 0
        self._head_ends = self.loop.call_later(self._head_s, self.transport.abort)

    def _end_head(self) -> None:
        if self._head_ends is not None:
            self._head_ends.cancel()
            self._head_ends = None


class SocketProtocol(WebSocketsSansIOProtocol):
    """WebSockets, of which refusing one with a response is no error: uvicorn (0.54) logs that nothing was answered."""

    async def send(self, message: Any) -> None:
        """Send what the application says."""
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and not message.get("more_body", False):
            self.handshake_complete = True


STOP_S: Final = 1
"""How long requests may take to end when the monitor stops, and browsers to let go."""

MAX_FRAME_BYTES: Final = 256 * 1024
"""Of what a browser sends at once over a WebSocket."""

GZIP_LEVEL: Final = 1
"""Compression happens on the event loop: the usual level 9 takes four times as long for a tenth less."""

LANGUAGE: Final = "en-US"

ICON: Final = "👁"


class _Server(uvicorn.Server):
    """Leaves signals to the process that it is a part of."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture none."""
        yield


async def serve(monitor: Monitor, listener: socket.socket, access: Access) -> None:
    """Serve at a listening socket until cancelled; it is closed then."""
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
        guarded(app, access, settings),
        log_config=None,
        log_level="warning",
        access_log=False,
        lifespan="on",
        http=BoundedProtocol,
        limit_concurrency=settings.web_connections,
        proxy_headers=settings.web_url is not None,
        server_header=False,
        timeout_graceful_shutdown=STOP_S,
        ws=SocketProtocol,
        ws_max_size=MAX_FRAME_BYTES,
    )
    server = _Server(config)
    serving = asyncio.ensure_future(server.serve(sockets=[listener]))
    try:
        await asyncio.shield(serving)
    finally:
        server.should_exit = True
        await asyncio.wait([serving])
