"""A thread for slow work, and how long such work took."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def worker_thread(name: str) -> Iterator[Executor]:
    """Run submitted calls in turn. Leaving does not wait for a call in progress, which may take seconds."""
    executor = ThreadPoolExecutor(1, thread_name_prefix=name)
    try:
        yield executor
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


class TimedExecutor(Executor):
    """Passes calls to an executor of one thread, and measures how long they run."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._ended_s = 0.0
        self._since_s: float | None = None

    @property
    def busy_s(self) -> float:
        """Seconds that calls ran so far, the running one included. Waiting for the thread does not count."""
        since_s = self._since_s
        return self._ended_s + (0.0 if since_s is None else time.monotonic() - since_s)

    def pending(self) -> object:
        """Return by what the running call is known, None while there is none; see `unanswered`."""
        return self._since_s

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a call once the thread is free."""
        return self._executor.submit(self._run, fn, *args, **kwargs)

    def _run(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        self._since_s = begun_s = time.monotonic()
        try:
            return fn(*args, **kwargs)
        finally:
            self._since_s = None
            self._ended_s += time.monotonic() - begun_s
