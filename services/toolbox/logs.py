"""Sets up a process's logging: one line per event on stderr, limited in rate."""

import logging
import os
import queue
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from logging.handlers import QueueHandler
from types import TracebackType
from typing import Final, TextIO

from schemas.printing import printable

_ErrorInfo = tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]

FORMAT: Final = "%(asctime)s %(levelname)-7s %(name)s: %(message)s"
PERIOD_S: Final = 10.0
MAX_SOURCES: Final = 1_024
MAX_EVENTS: Final = 100
MAX_WAITING: Final = 1_000


@dataclass(slots=True)
class _Window:
    opened: float
    held_back: int = 0


@dataclass(frozen=True, slots=True)
class Admitted:
    """An event that passes, and the number of events held back before it."""

    of_its_source: int = 0
    of_others: int = 0

    def __str__(self) -> str:
        """Return a note of the events held back, or an empty string."""
        more = f" (and {self.of_its_source} more like it)" if self.of_its_source else ""
        return more + (f" (and {self.of_others} events of other sources)" if self.of_others else "")


class RateLimit:
    """Lets one event per source through in each period, and `max_events` of all sources together; counts the rest."""

    def __init__(
        self, period_s: float = PERIOD_S, max_sources: int = MAX_SOURCES, max_events: int = MAX_EVENTS
    ) -> None:
        self._period_s = period_s
        self._max_sources = max_sources
        self._max_events = max_events
        self._sources: OrderedDict[tuple[object, ...], _Window] = OrderedDict()
        self._everybody = _Window(float("-inf"))
        self._let_through = 0

    def admit(self, source: tuple[object, ...], now: float) -> Admitted | None:
        """Return None to hold the event back."""
        window = self._sources.get(source)
        if window is not None and now - window.opened < self._period_s:
            window.held_back += 1
            return None
        others = 0
        if now - self._everybody.opened >= self._period_s:
            others, self._everybody, self._let_through = self._everybody.held_back, _Window(now), 0
        if self._let_through >= self._max_events:
            self._everybody.held_back += 1
            return None
        self._let_through += 1
        self._remember(source, now)
        return Admitted(window.held_back if window else 0, others)

    def _remember(self, source: tuple[object, ...], now: float) -> None:
        self._sources[source] = _Window(now)
        self._sources.move_to_end(source)
        if len(self._sources) > self._max_sources:
            self._sources.popitem(last=False)


class RateLimitFilter(logging.Filter):
    """Applies a RateLimit to warnings and errors; an event's source is its logger, text and first argument.

    clock: seconds; it must be steady, for by one that is set back nothing would be written until it was there again.
    """

    def __init__(self, limit: RateLimit, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._limit = limit
        self._clock = clock

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the record is written, with the count of those held back before it."""
        if record.levelno < logging.WARNING:
            return True
        first = str(record.args[0]) if isinstance(record.args, tuple) and record.args else ""
        admitted = self._limit.admit((record.name, record.msg, first), self._clock())
        if admitted is None:
            return False
        if more := str(admitted):
            record.msg, record.args = record.getMessage() + more, ()
        return True


class OneLine(logging.Formatter):
    """Formats messages with control characters escaped, since they may contain words of peers."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - the base class calls it so
        """Return the line, before any traceback."""
        record.message = printable(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: _ErrorInfo) -> str:  # noqa: N802 - the base class calls it so
        """Return a traceback's lines."""
        return "\n".join(map(printable, super().formatException(ei).split("\n")))


class StderrHandler(logging.StreamHandler[TextIO]):
    """Writes to the current sys.stderr, so that a live display on the terminal is not overwritten."""

    @property
    def stream(self) -> TextIO:
        """The stream to write to."""
        return sys.stderr

    @stream.setter
    def stream(self, _: TextIO) -> None:
        """Ignored: the base class would keep the initial stream."""


class WriterThread(QueueHandler):
    """Writes records on its own thread, so that a stalled reader of stderr blocks nobody.

    Records logged while MAX_WAITING are queued are dropped and counted.
    """

    def __init__(self, writer: logging.Handler) -> None:
        self._writer = writer
        self._left_out = 0
        self._begin()
        super().__init__(self._waiting)
        os.register_at_fork(after_in_child=self._begin)

    def _begin(self) -> None:
        """Start the writing thread; a forked process, as in training, does not inherit it."""
        self._waiting: queue.Queue[logging.LogRecord] = queue.Queue(MAX_WAITING)
        threading.Thread(target=self._write, name="log", daemon=True).start()

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        """Return the record with its text formatted now: its arguments may change."""
        record.msg, record.args = record.getMessage(), ()
        return record

    def enqueue(self, record: logging.LogRecord) -> None:
        """Pass a record on, with the number of those left out before it."""
        if self._left_out:
            record.msg += f" (and {self._left_out} events before it that nobody read)"
        try:
            self._waiting.put_nowait(record)
        except queue.Full:
            self._left_out += 1
        else:
            self._left_out = 0

    def flush(self) -> None:
        """Wait until all logged records are written."""
        self._waiting.join()

    def _write(self) -> None:
        while True:
            self._writer.handle(self._waiting.get())
            self._waiting.task_done()


def configure(level: str) -> None:
    """Write records of `level` and above to stderr."""
    writer = StderrHandler()
    writer.setFormatter(OneLine(FORMAT))
    handler = WriterThread(writer)
    handler.addFilter(RateLimitFilter(RateLimit()))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
    # otherwise it logs each request with its URL, which may be secret
    logging.getLogger("httpx").setLevel(logging.WARNING)
