"""Serves ROS's XML-RPC APIs: a bounded number of connections, one request and one deadline for each, bounded bodies."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Any, Protocol, Self

from aiohttp import web

from gateway.ros1.errors import StatusError, WireError, XmlRpcError
from gateway.ros1.hosts import listen, uri_host
from gateway.ros1.wire.xmlrpc import DEFAULT_MAX_BODY_BYTES, Body, Decoder, Fault, MethodCall, MethodResponse, encode

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable
    from types import TracebackType

_log = logging.getLogger(__name__)
_CHUNK_BYTES = 64 << 10
MAX_CONNECTIONS = 256
_SHUTDOWN_S = 0.1


class Api(Protocol):
    """What answers calls; must not block."""

    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        """Return the message and the value of a successful answer.

        Raises:
            StatusError: the answer has another code than success.
            LookupError: there is no such method.

        """


class XmlRpcServer:
    """An HTTP server for one API, on a port that the system chooses unless one is given.

    A connection is closed `timeout` seconds after it was made at the latest, whatever it has sent by then. Further
    connections than MAX_CONNECTIONS are closed at once.
    """

    def __init__(
        self,
        api: Api,
        *,
        host: str,
        port: int = 0,
        timeout: float = 5.0,
        max_body_bytes: int = DEFAULT_MAX_BODY_BYTES,
    ) -> None:
        self._api = api
        self._host = host
        self._port = port
        self._max_body_bytes = max_body_bytes
        self._http = _HttpServer(self._handle, timeout)
        self._server: asyncio.Server | None = None

    @property
    def uri(self) -> str:
        """Where others reach this server; known once entered."""
        return f"http://{uri_host(self._host)}:{self._port}/"

    async def __aenter__(self) -> Self:
        listener = listen(self._host, self._port)
        self._port = listener.getsockname()[1]
        # Whoever is cancelled while a server starts cannot close it, unless it is made first and started then.
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._http, sock=listener, start_serving=False)
        try:
            await self._server.start_serving()
        except BaseException:
            self._server.close()
            raise
        return self

    async def __aexit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        if self._server is not None:
            self._server.close()
        await self._http.shutdown(_SHUTDOWN_S)

    async def _handle(self, request: web.BaseRequest) -> web.StreamResponse:
        response = await self._respond(request)
        response.force_close()
        return response

    async def _respond(self, request: web.BaseRequest) -> web.Response:
        if request.method != "POST":
            return web.Response(status=405)
        try:
            body = await self._read(request)
        except WireError as error:
            _log.warning("%s sent a request that is not XML-RPC: %s", request.remote, error)
            return web.Response(status=400)
        return web.Response(body=_encode(self._answer(body)), content_type="text/xml")

    async def _read(self, request: web.BaseRequest) -> MethodCall:
        decoder = Decoder(self._max_body_bytes)
        async for chunk in request.content.iter_chunked(_CHUNK_BYTES):
            decoder.feed(chunk)
        body = decoder.close()
        if not isinstance(body, MethodCall):
            raise WireError("not a method call")
        return body

    def _answer(self, call: MethodCall) -> Body:
        try:
            message, value = self._api.call(call.method, call.params)
        except StatusError as error:
            return MethodResponse([error.code, error.reason, error.value])
        except LookupError:
            return Fault(1, f"no method {call.method[:80]!r}")
        return MethodResponse([1, message, value])


class _HttpServer(web.Server):
    """Bounds what aiohttp leaves open: the number of connections, and how long each may take."""

    def __init__(self, handler: Callable[[web.BaseRequest], Awaitable[web.StreamResponse]], timeout: float) -> None:
        super().__init__(handler, access_log=None)
        self._timeout = timeout
        self._deadlines: dict[web.RequestHandler, asyncio.TimerHandle] = {}

    def connection_made(self, handler: web.RequestHandler, transport: asyncio.Transport) -> None:
        super().connection_made(handler, transport)
        loop = asyncio.get_running_loop()
        if len(self._deadlines) >= MAX_CONNECTIONS:
            host = transport.get_extra_info("peername")[0]
            _log.warning("%s is turned away: %d connections already", host, MAX_CONNECTIONS)
            loop.call_soon(transport.abort)  # the handler's task must have begun
            return
        self._deadlines[handler] = loop.call_later(self._timeout, transport.abort)

    def connection_lost(self, handler: web.RequestHandler, exc: BaseException | None = None) -> None:
        super().connection_lost(handler, exc)
        deadline = self._deadlines.pop(handler, None)
        if deadline is not None:
            deadline.cancel()


def _encode(answer: Body) -> bytes:
    try:
        return encode(answer)
    except XmlRpcError as error:
        return encode(Fault(2, str(error)))
