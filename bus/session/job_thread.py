"""A thread that makes blocking calls, one after another, and some when they are due."""

import contextlib
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future

from bus.session.declaration import log_failure
from bus.session.panics import panics_are_errors


class JobThread:
    """Makes calls in the order in which they come, until it is ended.

    due: returns when something is due next, by `time.monotonic`, None if nothing is. do_due: called on the thread then.
    """

    def __init__(self, name: str, due: Callable[[], float | None], do_due: Callable[[], None]) -> None:
        self._due = due
        self._do_due = do_due
        self._jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def is_ending(self) -> bool:
        """Whether the thread ends with the call that it makes."""
        return self._ended

    def end(self) -> None:
        """Let the thread end once the calls so far are made. On the thread only."""
        self._ended = True

    def submit(self, act: Callable[[], None]) -> Future[None]:
        """Queue a call; one that comes after the end is not made. Any thread."""
        future: Future[None] = Future()

        def job() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                with panics_are_errors():
                    act()
            except Exception as error:  # noqa: BLE001 - it belongs to whoever waits for the future
                future.set_exception(error)
            else:
                future.set_result(None)

        if self._thread.is_alive():
            self._jobs.put(job)
        else:
            future.set_result(None)
        return future

    def do(self, act: Callable[[], None]) -> None:
        """Queue a call whose result nobody waits for. Any thread."""
        self.submit(act).add_done_callback(log_failure)

    def _run(self) -> None:
        while not self._ended:
            due_s = self._due()
            try:
                job = self._jobs.get(timeout=None if due_s is None else max(0, due_s - time.monotonic()))
            except queue.Empty:
                self._do_due()
            else:
                job()
        with contextlib.suppress(queue.Empty):
            while True:
                self._jobs.get_nowait()()
