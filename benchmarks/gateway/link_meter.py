"""A way for one Zenoh TCP link that counts what crosses it."""

import socket
import struct
import threading
from contextlib import suppress
from typing import Final, Self

_LENGTH: Final = struct.Struct("<H")
_KEEP_ALIVE: Final = 0x04
_KIND: Final = 0x1F


class LinkMeter:
    """Passes one connection on to `port`; `payload_bytes` counts both directions' batches other than keep-alives."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets = [self._listener]
        self._lock = threading.Lock()
        self.payload_bytes = 0

    @property
    def endpoint(self) -> str:
        """Where to connect instead."""
        return f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"

    def __enter__(self) -> Self:
        threading.Thread(target=self._run, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        for each in self._sockets:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _run(self) -> None:
        with suppress(OSError):
            near, _ = self._listener.accept()
            far = socket.create_connection(("127.0.0.1", self._port))
            self._sockets += [near, far]
            threading.Thread(target=self._pump, args=(far, near), daemon=True).start()
            self._pump(near, far)

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while prefix := source.recv(_LENGTH.size, socket.MSG_WAITALL):
                (length,) = _LENGTH.unpack(prefix)
                batch = source.recv(length, socket.MSG_WAITALL)
                if not (length == 1 and batch[0] & _KIND == _KEEP_ALIVE):
                    with self._lock:
                        self.payload_bytes += length
                sink.sendall(prefix + batch)
