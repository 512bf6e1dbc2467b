"""Calls ROS's XML-RPC APIs, each with a deadline and a bounded answer."""

from __future__ import annotations

import asyncio
from asyncio import Semaphore
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, Final, Self
from urllib.parse import urlsplit
from weakref import WeakValueDictionary

from gateway.ros1.errors import HttpError, UnreachableError
from gateway.ros1.resolver import Resolver
from gateway.ros1.wire.http import ClientExchange
from gateway.ros1.wire.xmlrpc import DEFAULT_MAX_BODY_BYTES, MethodCall, result_of

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from types import TracebackType

    from gateway.ros1.wire.xmlrpc import Body


AT_A_HOST: Final = 64
IN_ALL: Final = 256


class CallSlots:
    """Limits concurrent calls to AT_A_HOST for each host, and to IN_ALL together."""

    def __init__(self) -> None:
        self._all = Semaphore(IN_ALL)
        self._at: WeakValueDictionary[str, Semaphore] = WeakValueDictionary()

    @asynccontextmanager
    async def at(self, host: str) -> AsyncIterator[None]:
        """Wait for a slot and hold it while the context lasts."""
        at_host = self._at.setdefault(host, Semaphore(AT_A_HOST))  # exists while somebody waits or calls
        async with at_host, self._all:
            yield


_PIECE_BYTES: Final = 16 << 10
_HTTP_PORT: Final = 80


class XmlRpcClient:
    """One client for all peers; enter it before calling. Leaving it cancels no call: calls belong to their callers.

    resolver: what it looks up the peers' names with, for whoever connects to them too.
    """

    def __init__(self, *, timeout: float = 5.0, max_body_bytes: int = DEFAULT_MAX_BODY_BYTES) -> None:
        self._timeout = timeout
        self._max_body_bytes = max_body_bytes
        self._places: CallSlots | None = None
        self.resolver = Resolver()

    async def __aenter__(self) -> Self:
        self._places = CallSlots()
        return self

    async def __aexit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        self._places = None

    async def call(self, uri: str, method: str, *params: Any) -> Any:
        """Return the value in the peer's `[code, message, value]`.

        Raises:
            UnreachableError: no answer within the deadline, or not HTTP's 200.
            FaultError, StatusError: the peer says that it did not succeed.
            XmlRpcError: the answer, or a parameter, is not XML-RPC.

        """
        if self._places is None:
            raise RuntimeError("XmlRpcClient is used before it is entered")
        try:
            async with asyncio.timeout(self._timeout), self._places.at(urlsplit(uri).hostname or ""):
                body = await self._exchange(uri, MethodCall(method, params))
        except TimeoutError as error:
            raise UnreachableError(f"{uri} {method}: no answer within {self._timeout} s") from error
        except (HttpError, OSError, ValueError) as error:
            raise UnreachableError(f"{uri} {method}: {error}") from error
        return result_of(body)

    async def _exchange(self, uri: str, call: MethodCall) -> Body:
        address = urlsplit(uri)
        if address.scheme != "http" or not address.hostname:
            raise HttpError("not the address of an HTTP server")
        exchange = ClientExchange(
            host=address.netloc, target=address.path or "/", call=call, max_body_bytes=self._max_body_bytes
        )
        # A peer may restart on the same port at any time: no connection is kept for a second call.
        port = address.port or _HTTP_PORT
        reader, writer = await self.resolver.connect(address.hostname, lambda host: asyncio.open_connection(host, port))
        try:
            writer.write(exchange.opening)
            # Reading available data does not yield to the event loop, but other tasks need their turn.
            while (body := exchange.receive_data(await reader.read(_PIECE_BYTES))) is None:  # noqa: ASYNC110
                await asyncio.sleep(0)
        finally:
            exchange.close()
            writer.transport.abort()
        return body
