"""Errors of the ROS 1 protocol.

Ros1Error
├── InvalidNameError        not a legal graph resource name
├── WireError               bytes that are not the protocol
│   ├── HeaderError         a connection header
│   ├── TcprosError         a TCPROS stream after or around its header
│   │   └── TooLargeError       a message over the limit of whoever subscribes
│   ├── HttpError           HTTP under XML-RPC
│   └── XmlRpcError         an XML-RPC body, or a value that cannot become one
├── MessageError            bytes that are not a message of the given type, or the reverse
│   └── UnknownTypeError    a message type without a known definition
├── UnknownMethodError      no such method in the master or slave API that was called here
├── LinkRefusedError        the peer of a TCPROS connection answered `error=`
├── TypeMismatchError       the publisher's or service's type or md5sum is not the expected one
├── ServiceError            a ROS service was not called, or did not answer
│   ├── UnknownServiceError     the master knows no service of that name
│   ├── ServiceTimeoutError     no answer in time
│   └── ServiceFailedError      the service answered that it failed
└── CallError               a call of the master or slave API did not succeed
    ├── UnreachableError    no answer: refused, timed out, closed, or not HTTP's 200
    ├── FaultError          an XML-RPC fault
    └── StatusError         an answer whose status code is not success
"""

from __future__ import annotations

from typing import Final

ERROR: Final = -1
"""ROS's status code of invalid calls: nothing was done."""

FAILURE: Final = 0
"""ROS's status code of valid calls that failed, perhaps half done."""


class Ros1Error(Exception):
    """Base class of all errors of this package."""


class InvalidNameError(Ros1Error, ValueError):
    """Not a legal graph resource name or address."""


class WireError(Ros1Error):
    """Bytes that violate the protocol."""


class HeaderError(WireError):
    """A connection header that is malformed or over a limit."""


class TcprosError(WireError):
    """A TCPROS stream that is malformed or over a limit."""


class TooLargeError(TcprosError):
    """A message over its subscriber's limit. size, limit: in bytes."""

    def __init__(self, size: int, limit: int) -> None:
        super().__init__(f"a message of {size:,} bytes, over the limit of {limit:,}")
        self.size = size
        self.limit = limit


class HttpError(WireError):
    """HTTP that is malformed, over a limit or unexpected.

    status: what a server answers to it.
    """

    def __init__(self, reason: str, status: int = 400) -> None:
        super().__init__(reason)
        self.status = status


class XmlRpcError(WireError):
    """An XML-RPC body that is malformed or over a limit, or a value that XML-RPC cannot carry."""


class MessageError(Ros1Error):
    """Bytes that are not a message of the given type, or a message that cannot be serialised."""


class UnknownTypeError(MessageError):
    """A message type without a known definition."""


class UnknownMethodError(Ros1Error, LookupError):
    """The API of this process has no such method."""


class LinkRefusedError(Ros1Error):
    """The peer answered the connection header with `error=`."""


class TypeMismatchError(Ros1Error):
    """The publisher's or service's type or md5sum is not the expected one."""


class ServiceError(Ros1Error):
    """A ROS service was not called, or did not answer."""


class UnknownServiceError(ServiceError):
    """The master knows no service of that name."""


class ServiceTimeoutError(ServiceError):
    """The service did not answer in time; it may or may not have acted."""


class ServiceFailedError(ServiceError):
    """The service reported a failure, with its own text."""


class CallError(Ros1Error):
    """A call of the master or slave API failed."""


class UnreachableError(CallError):
    """No answer: connection refused, timed out, closed early, or an HTTP status other than 200."""


class FaultError(CallError):
    """The peer answered with an XML-RPC fault."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(f"fault {code}: {message}")
        self.code = code


class StatusError(CallError):
    """The peer answered with ROS's status code FAILURE or ERROR."""

    def __init__(self, code: int, reason: str, value: object = 0) -> None:
        super().__init__(f"status {code}: {reason}")
        self.code = code
        self.reason = reason
        self.value = value
