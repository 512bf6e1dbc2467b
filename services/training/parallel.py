"""Runs long work in several processes, with progress reports."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Protocol, TypeVar

import cv2

from fleetsight.spawned_process import begin

Job = TypeVar("Job")


def run(work: Callable[[Job], None], jobs: Sequence[Job], workers: int, report: Callable[[int], None]) -> None:
    """Run all jobs, in this process if one is enough, and report the number done after each.

    Where `report` or a job raises, jobs that have not begun never do. work: a function that other processes can import.
    """
    if workers == 1 or len(jobs) < 2:
        _report_each(map(work, jobs), report)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=begin, initargs=(_begin,)) as pool:
        try:
            _report_each(pool.map(work, jobs), report)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def end() -> None:
    """End the worker processes; a `run` that waits for them raises."""
    for process in multiprocessing.active_children():
        process.kill()


def _begin() -> None:
    """Use one processor, and end with the parent process, however that ends."""
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None  # noqa: S101 - this process is a pool's
    parent.join()
    os._exit(1)


def _report_each(ends: Iterable[None], report: Callable[[int], None]) -> None:
    for done, _ in enumerate(ends, start=1):
        report(done)


class Progress(Protocol):
    """Called as `progress(stage, done, total)`; `done` counts up to `total` within each stage.

    An exception from it ends the run, which can be resumed later.
    """

    def __call__(self, stage: str, done: int, total: int, /) -> None: ...
