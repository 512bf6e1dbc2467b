"""TCP ports that are free on this machine."""

import socket
from contextlib import ExitStack, suppress


def free_ports(count: int) -> int:
    """Return the first of `count` successive TCP ports of the loopback interface that nobody listens on."""
    while True:
        with ExitStack() as stack, suppress(OSError, OverflowError):
            first = _bound(stack, 0)
            for port in range(first + 1, first + count):
                _bound(stack, port)
            return first


def _bound(stack: ExitStack, port: int) -> int:
    listening = stack.enter_context(socket.socket())
    listening.bind(("127.0.0.1", port))
    bound: int = listening.getsockname()[1]
    return bound
