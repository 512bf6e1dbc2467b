"""A thread for slow work."""

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager


@contextmanager
def worker_thread(name: str) -> Iterator[Executor]:
    """Run submitted calls in turn. Leaving does not wait for a call in progress, which may take seconds."""
    executor = ThreadPoolExecutor(1, thread_name_prefix=name)
    try:
        yield executor
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
