"""Serves ROS's XML-RPC APIs: a bounded number of connections, one request and one deadline for each, bounded bodies."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Any, Final, Protocol, Self

from gateway.ros1.errors import FAILURE, StatusError, UnknownMethodError, XmlRpcError
from gateway.ros1.listening import Acceptor, listen, uri_host
from gateway.ros1.tasks import to_the_end
from gateway.ros1.wire.xmlrpc import DEFAULT_MAX_BODY_BYTES, Body, Fault, MethodResponse, encode
from gateway.ros1.xmlrpc.connection import Connections, ServerConnection

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable
    from types import TracebackType

    from gateway.ros1.wire.xmlrpc import MethodCall

log = logging.getLogger(__name__)

MAX_CONNECTIONS: Final = 256
_MAX_HELD_BODIES: Final = 4
_SHUTDOWN_S: Final = 0.1


class Api(Protocol):
    """The object that answers calls; it must not block."""

    def call(self, method: str, params: tuple[Any, ...]) -> tuple[str, Any]:
        """Return the message and the value of a successful answer.

        Raises:
            StatusError: the answer has another code than success.
            UnknownMethodError: there is no such method.

        """


class XmlRpcServer:
    """An HTTP server for one API, on a port that the system chooses unless one is given.

    A connection is closed `timeout` seconds after it was made at the latest, whatever it has sent by then. Further
    connections than MAX_CONNECTIONS are closed at once. Requests under way hold as much as four bodies of
    `max_body_bytes` at most; beyond it the largest is closed. `check` is called with the peer's address and the method
    before each call; a StatusError that it raises is the answer.
    """

    def __init__(
        self,
        api: Api,
        *,
        host: str,
        port: int = 0,
        timeout: float = 5.0,
        max_body_bytes: int = DEFAULT_MAX_BODY_BYTES,
        check: Callable[[str, str], None] | None = None,
    ) -> None:
        self._api = api
        self._host = host
        self._port = port
        self._timeout = timeout
        self._max_body_bytes = max_body_bytes
        self._check = check
        self._connections = Connections(limit=MAX_CONNECTIONS, max_held_bytes=_MAX_HELD_BODIES * max_body_bytes)
        self._acceptor: Acceptor | None = None
        self._connecting: set[asyncio.Task[object]] = set()

    @property
    def uri(self) -> str:
        """The server's URI for other nodes; known once entered."""
        return f"http://{uri_host(self._host)}:{self._port}/"

    async def __aenter__(self) -> Self:
        listener = listen(self._host, self._port)
        self._port = listener.getsockname()[1]
        self._acceptor = Acceptor(listener, self._connect)
        return self

    async def __aexit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        if self._acceptor is not None:
            self._acceptor.close()
        await to_the_end(self._end())

    async def _end(self) -> None:
        if self._connecting:
            await asyncio.wait(self._connecting)
        await self._connections.end(_SHUTDOWN_S)

    def _connect(self, connection: socket.socket, _peer: str) -> None:
        loop = asyncio.get_running_loop()
        task = loop.create_task(loop.connect_accepted_socket(self._connection, connection))
        self._connecting.add(task)
        task.add_done_callback(self._connecting.discard)

    def _connection(self) -> ServerConnection:
        return ServerConnection(
            self._connections, self._answer_to, timeout=self._timeout, max_body_bytes=self._max_body_bytes
        )

    def _answer_to(self, call: MethodCall, peer: str) -> bytes:
        """Return the body that answers a call."""
        answer = self._answer(call, peer)
        try:
            return encode(answer)
        except XmlRpcError as error:
            return encode(Fault(2, str(error)))

    def _answer(self, call: MethodCall, peer: str) -> Body:
        try:
            if self._check is not None:
                self._check(peer, call.method)
            message, value = self._api.call(call.method, call.params)
        except StatusError as error:
            return MethodResponse([error.code, error.reason, error.value])
        except UnknownMethodError as error:
            return Fault(1, str(error))
        except Exception:
            log.exception("%s failed", call.method[:80])
            return MethodResponse([FAILURE, "internal failure", 0])  # as rosmaster and rospy answer
        return MethodResponse([1, message, value])
