"""Calls ROS's XML-RPC APIs, each with a deadline and a bounded answer."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Self

import aiohttp

from gateway.ros1.errors import UnreachableError, XmlRpcError
from gateway.ros1.wire.xmlrpc import DEFAULT_MAX_BODY_BYTES, Decoder, MethodCall, encode, result_of

if TYPE_CHECKING:
    from types import TracebackType

_HEADERS = {"Content-Type": "text/xml", "Accept-Encoding": "identity"}
_CHUNK_BYTES = 64 << 10


class XmlRpcClient:
    """One HTTP client for all peers; enter it before calling."""

    def __init__(self, *, timeout: float = 5.0, max_body_bytes: int = DEFAULT_MAX_BODY_BYTES) -> None:
        self._timeout = timeout
        self._max_body_bytes = max_body_bytes
        self._session: aiohttp.ClientSession | None = None

    async def __aenter__(self) -> Self:
        # A peer may restart on the same port at any time: no connection is kept for a second call.
        connector = aiohttp.TCPConnector(force_close=True, limit=64)
        self._session = aiohttp.ClientSession(connector=connector, auto_decompress=False)
        return self

    async def __aexit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        if self._session is not None:
            await self._session.close()

    async def call(self, uri: str, method: str, *params: Any) -> Any:
        """Return the value out of the peer's `[code, message, value]`.

        Raises:
            UnreachableError: no answer within the deadline, or not HTTP's 200.
            FaultError, StatusError: the peer says that it did not succeed.
            XmlRpcError: the answer, or a parameter, is not XML-RPC.

        """
        body = encode(MethodCall(method, params))
        try:
            async with asyncio.timeout(self._timeout):
                decoder = await self._post(uri, body)
        except TimeoutError as error:
            raise UnreachableError(f"{uri} {method}: no answer within {self._timeout} s") from error
        except (aiohttp.ClientError, OSError, ValueError) as error:
            raise UnreachableError(f"{uri} {method}: {error}") from error
        return result_of(decoder.close())

    async def _post(self, uri: str, body: bytes) -> Decoder:
        if self._session is None:
            raise RuntimeError("XmlRpcClient is used before it is entered")
        decoder = Decoder(self._max_body_bytes)
        async with self._session.post(uri, data=body, headers=_HEADERS, allow_redirects=False) as response:
            if response.status != 200:
                raise UnreachableError(f"{uri} answers with HTTP status {response.status}")
            if (response.content_length or 0) > self._max_body_bytes:
                raise XmlRpcError(f"{uri} announces {response.content_length} bytes")
            async for chunk in response.content.iter_chunked(_CHUNK_BYTES):
                decoder.feed(chunk)
        return decoder
