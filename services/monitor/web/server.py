"""Serve page and API from the monitor's own event loop."""

import asyncio
import contextlib
import socket
from collections.abc import Iterator
from functools import partial
from typing import Final

import uvicorn
from fastapi.middleware.gzip import GZipMiddleware
from nicegui import ui

from services.monitor.monitor import Monitor
from services.monitor.page import add_pages
from services.monitor.web.application import guarded, make_application
from services.monitor.web.auth.access import Access
from services.monitor.web.protocol import BoundedProtocol, SocketProtocol

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
