"""Bounded XML-RPC bodies: calls, responses and faults, and ROS's triple in responses.

Marshalling is the standard library's; parsing goes through defusedxml, which refuses DTDs, entity declarations and
external references.
"""

from __future__ import annotations

import re
import xmlrpc.client
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeAlias

from defusedxml.xmlrpc import DefusedExpatParser

from gateway.ros1.errors import FaultError, StatusError, XmlRpcError
from gateway.ros1.wire.text import one_line

DEFAULT_MAX_BODY_BYTES = 8 << 20
MAX_DEPTH = 100
_ILLEGAL_IN_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, slots=True)
class MethodCall:
    method: str
    params: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class MethodResponse:
    value: Any


@dataclass(frozen=True, slots=True)
class Fault:
    code: int
    message: str


Body: TypeAlias = MethodCall | MethodResponse | Fault


def encode(body: Body) -> bytes:
    """Return the XML of a body.

    Raises:
        XmlRpcError: a value is outside of what XML-RPC carries (None, integers over 32 bits, control characters).

    """
    try:
        text = _encode(body)
    except Exception as error:
        raise XmlRpcError(f"cannot be XML-RPC: {error}") from error
    if _ILLEGAL_IN_XML.search(text):
        raise XmlRpcError("text with characters that XML does not have")
    return text.encode()


def _encode(body: Body) -> str:
    match body:
        case MethodCall(method, params):
            return xmlrpc.client.dumps(params, method)
        case MethodResponse(value):
            return xmlrpc.client.dumps((value,), methodresponse=True)
        case Fault(code, message):
            return xmlrpc.client.dumps(xmlrpc.client.Fault(code, _ILLEGAL_IN_XML.sub("?", message)))


class Decoder:
    """Decodes one body from pieces of any size."""

    def __init__(self, max_bytes: int = DEFAULT_MAX_BODY_BYTES) -> None:
        self._max_bytes = max_bytes
        self._received = 0
        self._target = _BoundedUnmarshaller()
        self._parser = DefusedExpatParser(self._target, forbid_dtd=True)

    def feed(self, data: bytes) -> None:
        """Take the next piece.

        Raises:
            XmlRpcError: malformed, dangerous, too deep or too long.

        """
        self._received += len(data)
        if self._received > self._max_bytes:
            raise XmlRpcError(f"body over the limit of {self._max_bytes} bytes")
        try:
            self._parser.feed(data)
        except Exception as error:
            raise XmlRpcError(f"not XML-RPC: {error!r}") from error

    def discard(self) -> None:
        """Release the parser, its target and all values, which refer to each other."""
        with suppress(Exception):
            self._parser.close()

    def close(self) -> Body:
        """Return the body after its last piece.

        Raises:
            XmlRpcError: malformed or cut off.

        """
        try:
            self._parser.close()
            values, method = self._target.close(), self._target.getmethodname()
        except xmlrpc.client.Fault as fault:
            return _fault(fault)
        except Exception as error:
            raise XmlRpcError(f"not XML-RPC: {error!r}") from error
        if method is not None:
            return MethodCall(method, tuple(values))
        if len(values) != 1:
            raise XmlRpcError(f"response with {len(values)} values instead of one")
        return MethodResponse(values[0])


def _fault(fault: xmlrpc.client.Fault) -> Fault:
    code: Any = fault.faultCode
    message: Any = fault.faultString
    if not isinstance(code, int) or not isinstance(message, str):
        raise XmlRpcError("fault without code and text")
    return Fault(code, message)


class _BoundedUnmarshaller(xmlrpc.client.Unmarshaller):
    def __init__(self) -> None:
        super().__init__(use_builtin_types=True)
        self._depth = 0

    def start(self, tag: str, attrs: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise XmlRpcError(f"nested deeper than {MAX_DEPTH}")
        super().start(tag, attrs)

    def end(self, tag: str) -> None:
        self._depth -= 1
        super().end(tag)


def result_of(body: Body) -> Any:
    """Return the value in ROS's `[code, message, value]`.

    Raises:
        FaultError: the body is a fault.
        StatusError: the code is not 1 (success).
        XmlRpcError: the body is a call, or its value is not such a triple.

    """
    match body:
        case MethodResponse([int(code), str(message), value]):
            if code != 1:
                raise StatusError(code, one_line(message))
            return value
        case Fault(code, message):
            raise FaultError(code, one_line(message))
        case _:
            raise XmlRpcError(f"not a [code, message, value] response: {str(body)[:200]}")
