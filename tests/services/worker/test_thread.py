import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from services.worker.thread import TimedExecutor, worker_thread


def test_time_counts_while_a_call_runs_and_not_while_none_does(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 0.0
    monkeypatch.setattr("services.worker.thread.time", SimpleNamespace(monotonic=lambda: now_s))
    begun, go = threading.Event(), threading.Event()

    def work() -> str:
        begun.set()
        go.wait()
        return "done"

    with worker_thread("test") as thread:
        executor = TimedExecutor(thread)
        running, waiting = executor.submit(work), executor.submit(lambda: None)
        begun.wait()
        assert executor.busy_s == 0
        now_s = 2.0
        assert executor.busy_s == 2
        go.set()
        assert running.result() == "done"
        waiting.result()
        now_s = 9.0
        assert executor.busy_s == 2


def test_a_call_that_fails_counts_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    times_s = iter((1.0, 4.0))
    monkeypatch.setattr("services.worker.thread.time", SimpleNamespace(monotonic=lambda: next(times_s)))

    def fail() -> None:
        raise ValueError("no")

    with ThreadPoolExecutor(1) as thread:
        executor = TimedExecutor(thread)
        with pytest.raises(ValueError, match="no"):
            executor.submit(fail).result()
        assert executor.busy_s == 3
