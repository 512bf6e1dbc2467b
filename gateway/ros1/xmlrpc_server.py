"""Serves ROS's XML-RPC APIs: bounded bodies, a deadline for every request, one answer at a time decided in no time."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Any, Protocol, Self

from aiohttp import web

from gateway.ros1.errors import StatusError, WireError, XmlRpcError
from gateway.ros1.hosts import listen, uri_host
from gateway.ros1.lograte import LogRate
from gateway.ros1.wire.xmlrpc import DEFAULT_MAX_BODY_BYTES, Body, Decoder, Fault, MethodCall, MethodResponse, encode

if TYPE_CHECKING:
    from types import TracebackType

_log = logging.getLogger(__name__)
_CHUNK_BYTES = 64 << 10
_MAX_CONCURRENT = 256
_SHUTDOWN_S = 0.5


class Api(Protocol):
    """What answers calls; must not block."""

    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        """Return the message and the value of a successful answer.

        Raises:
            StatusError: the answer has another code than success.
            LookupError: there is no such method.

        """


class XmlRpcServer:
    """An HTTP server for one API, on a port that the system chooses unless one is given."""

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
        self._timeout = timeout
        self._max_body_bytes = max_body_bytes
        self._active = 0
        self._log_rate = LogRate()
        self._http = web.Server(self._handle, access_log=None)
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
        if request.method != "POST":
            return web.Response(status=405)
        if self._active >= _MAX_CONCURRENT:
            return web.Response(status=503)
        self._active += 1
        try:
            async with asyncio.timeout(self._timeout):
                body = await self._read(request)
        except WireError as error:
            level = self._log_rate.level(asyncio.get_running_loop().time())
            _log.log(level, "a request from %s is not XML-RPC: %s", request.remote, error)
            return web.Response(status=400)
        except TimeoutError:
            return web.Response(status=408)
        finally:
            self._active -= 1
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


def _encode(answer: Body) -> bytes:
    try:
        return encode(answer)
    except XmlRpcError as error:
        return encode(Fault(2, str(error)))
