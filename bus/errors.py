"""Errors that this package raises.

BusError
├── BusClosedError
└── RequestError
    ├── NotServedError
    ├── RequestTimeoutError
    └── RefusedError
"""


class BusError(Exception):
    """The bus cannot do what was asked: a bad key, a refused endpoint, a declaration that failed."""


class BusClosedError(BusError):
    """The bus, or the publisher, subscription or watch used, has been closed."""


class RequestError(BusError):
    """A request failed. The text is for the caller and does not repeat the key."""


class NotServedError(RequestError):
    """No server has the key, or it left before answering."""


class RequestTimeoutError(RequestError):
    """No answer came in time."""


class RefusedError(RequestError):
    """The server answered with an error. Raised by a handler, its text is what the caller sees, in one line."""
