"""A thread that writes what the event loop hands over, so that a slow link never holds the loop up."""

import logging
import threading
from collections.abc import Hashable
from typing import Final, Protocol

from bus.mailbox import PerKey

_log: Final = logging.getLogger(__name__)


class Writer(Hashable, Protocol):
    """One publisher as its lane sees it."""

    def write(self, payload: bytes | bytearray) -> None:
        """Send a message; may take a while."""

    def count_dropped(self, number: int) -> None:
        """Count messages that were not sent."""


class Lane:
    """Bounded queues of many publishers, served in turn by one thread.

    A publisher's messages wait until it is admitted, which is when there is a link that takes them.
    """

    def __init__(self, name: str, depth: int) -> None:
        self._name = name
        self._changed = threading.Condition()
        self._held: PerKey[Writer, bytes | bytearray] = PerKey(depth)
        self._ready: PerKey[Writer, bytes | bytearray] = PerKey(depth)
        self._admitted: set[Writer] = set()
        self._writing: Writer | None = None
        self._thread: threading.Thread | None = None
        self._stopping = False

    def offer(self, writer: Writer, payload: bytes | bytearray) -> None:
        """Queue a message. Never blocks for longer than it takes another thread to queue one."""
        with self._changed:
            queue = self._ready if writer in self._admitted else self._held
            dropped = queue.offer(writer, payload)
            self._changed.notify_all()
        if dropped:
            writer.count_dropped(dropped)

    def admit(self, writer: Writer) -> None:
        """Send from now on what a publisher queues, and what it has queued."""
        with self._changed:
            self._admitted.add(writer)
            for payload in self._held.discard(writer):
                self._ready.offer(writer, payload)
            self._changed.notify_all()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=f"bus-{self._name}", daemon=True)
                self._thread.start()

    def retire(self, writer: Writer, grace_s: float) -> None:
        """Wait up to `grace_s` until a publisher's queue is written, drop the rest; then it is not written to again."""
        with self._changed:
            if writer in self._admitted:
                self._changed.wait_for(lambda: writer not in self._ready and self._writing is not writer, grace_s)
            self._admitted.discard(writer)
            rest = len(self._held.discard(writer)) + len(self._ready.discard(writer))
        if rest:
            writer.count_dropped(rest)

    def stop(self, grace_s: float) -> None:
        """End the thread; not to be called from it."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join(grace_s)

    def _run(self) -> None:
        while (writing := self._next()) is not None:
            writer, payload = writing
            try:
                writer.write(payload)
            except Exception as error:  # noqa: BLE001 - whatever one message meets, the lane serves the others
                writer.count_dropped(1)
                _log.debug("a message was not sent: %s", error)
            finally:
                with self._changed:
                    self._writing = None
                    self._changed.notify_all()

    def _next(self) -> tuple[Writer, bytes | bytearray] | None:
        with self._changed:
            while not self._stopping:
                taken = self._ready.take()
                if taken is not None:
                    self._writing = taken.key
                    return taken.key, taken.item
                self._changed.wait()
            return None
