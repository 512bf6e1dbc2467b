"""HTTP for XML-RPC without I/O: one bounded request and answer per connection.

Peers speak HTTP/1.0 and 1.1; a connection is closed after its answer, which all of them take.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import h11

from gateway.ros1.errors import HttpError, XmlRpcError
from gateway.ros1.wire.xmlrpc import Decoder, MethodCall, encode

if TYPE_CHECKING:
    from gateway.ros1.wire.xmlrpc import Body

MAX_HEAD_BYTES: Final = 16 << 10
_TEXT: Final = ("Content-Type", "text/xml")
_CLOSE: Final = ("Connection", "close")


class _Side:
    """One side of a connection. http: the h11 connection."""

    def __init__(self, http: h11.Connection, max_body_bytes: int) -> None:
        self._http = http
        self._max_body_bytes = max_body_bytes
        self._decoder = Decoder(max_body_bytes)

    def close(self) -> None:
        """Release the received data; the connection has ended."""
        self._decoder.discard()

    def _receive(self, data: bytes) -> bool:
        """Take received bytes; return whether the peer's message is complete."""
        try:
            self._http.receive_data(data)
            while True:
                match self._http.next_event():
                    case h11.Request() | h11.Response() as head:
                        self._check(head)
                    case h11.Data(data=piece):
                        self._decoder.feed(bytes(piece))
                    case h11.EndOfMessage():
                        return True
                    case h11.InformationalResponse():
                        continue
                    case h11.ConnectionClosed():
                        raise HttpError("the connection ended before anything came")
                    case _:
                        return False
        except h11.RemoteProtocolError as error:
            reason = str(error) if data else "the connection ended before all of the message came"
            raise HttpError(reason, status=error.error_status_hint) from error

    def _check(self, head: h11.Request | h11.Response) -> None:
        announced = next((int(value) for name, value in head.headers if name == b"content-length"), 0)
        if announced > self._max_body_bytes:
            raise XmlRpcError(f"{announced} bytes are announced, over the limit of {self._max_body_bytes}")

    def _send(self, head: h11.Request | h11.Response, body: bytes) -> bytes:
        parts = [self._http.send(part) for part in (head, h11.Data(body), h11.EndOfMessage())]
        return b"".join(part or b"" for part in parts)


class ServerExchange(_Side):
    """The server's side: feed received bytes until the call is complete, then send `answer` or `refuse`."""

    def __init__(self, max_body_bytes: int) -> None:
        super().__init__(h11.Connection(h11.SERVER, MAX_HEAD_BYTES), max_body_bytes)

    def receive_data(self, data: bytes) -> MethodCall | None:
        """Take received bytes, none at the end of the stream; None means that more are needed.

        Raises:
            HttpError: not HTTP, or no POST.
            XmlRpcError: not a method call, or over a limit.

        """
        if not self._receive(data):
            return None
        call = self._decoder.close()
        if not isinstance(call, MethodCall):
            raise XmlRpcError("not a method call")
        return call

    def _check(self, head: h11.Request | h11.Response) -> None:
        if isinstance(head, h11.Request) and head.method != b"POST":
            raise HttpError("no POST", status=405)
        # No ROS node sends chunked bodies, and many small chunks cost far more time than their bytes.
        if any(name == b"transfer-encoding" for name, _ in head.headers):
            raise HttpError("a length is needed", status=411)
        super()._check(head)

    def answer(self, body: bytes) -> bytes:
        """Return the bytes of a successful answer."""
        return self._respond(200, body)

    def refuse(self, status: int) -> bytes:
        """Return the bytes of an answer without a body; none if there was no request."""
        return b"" if self._http.our_state is h11.MUST_CLOSE else self._respond(status, b"")

    def _respond(self, status: int, body: bytes) -> bytes:
        headers = [_TEXT, ("Content-Length", str(len(body))), _CLOSE]
        return self._send(h11.Response(status_code=status, headers=headers), body)


class ClientExchange(_Side):
    """The client's side: send `opening`, then feed received bytes until the answer is complete.

    Raises:
        HttpError: host and target cannot stand in a request.
        XmlRpcError: the call cannot be XML-RPC.

    """

    def __init__(self, *, host: str, target: str, call: MethodCall, max_body_bytes: int) -> None:
        super().__init__(h11.Connection(h11.CLIENT, MAX_HEAD_BYTES), max_body_bytes)
        body = encode(call)
        headers = [("Host", host), _TEXT, ("Content-Length", str(len(body))), _CLOSE]
        try:
            self.opening = self._send(h11.Request(method="POST", target=target, headers=headers), body)
        except (h11.LocalProtocolError, UnicodeEncodeError) as error:
            raise HttpError(f"no address: {error}") from error

    def receive_data(self, data: bytes) -> Body | None:
        """Take received bytes, none at the end of the stream; None means that more are needed.

        Raises:
            HttpError: not HTTP, cut off, or another status than 200.
            XmlRpcError: the body is not XML-RPC, or over a limit.

        """
        return self._decoder.close() if self._receive(data) else None

    def _check(self, head: h11.Request | h11.Response) -> None:
        if isinstance(head, h11.Response) and head.status_code != 200:
            raise HttpError(f"HTTP status {head.status_code}")
        super()._check(head)
