"""A thread for what takes long."""

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager


@contextmanager
def worker_thread(name: str) -> Iterator[Executor]:
    """Run what is submitted in turn. Leaving does not wait for what is under way, which may take seconds."""
    executor = ThreadPoolExecutor(1, thread_name_prefix=name)
    try:
        yield executor
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
