import io
import logging
import re
import subprocess
import sys
import threading
import time

import pytest

from services.toolbox.logs import (
    FORMAT,
    MAX_WAITING,
    Admitted,
    OneLine,
    RateLimit,
    RateLimitFilter,
    StderrHandler,
    WriterThread,
)


def test_one_event_a_period_and_the_count_of_the_rest() -> None:
    limit = RateLimit(period_s=10)
    assert limit.admit(("a",), 0) == Admitted()
    assert limit.admit(("a",), 0) is None
    assert limit.admit(("a",), 9.9) is None
    assert limit.admit(("a",), 10) == Admitted(of_its_source=2)
    assert limit.admit(("a",), 20) == Admitted()


def test_sources_do_not_share_a_limit() -> None:
    limit = RateLimit(period_s=10)
    assert [limit.admit((source,), 0) for source in "aba"] == [Admitted(), Admitted(), None]


def test_many_sources_together_are_limited_too() -> None:
    limit = RateLimit(period_s=10, max_sources=4, max_events=20)
    let_through = [limit.admit((number % 50,), now=number / 1000) for number in range(5000)]
    assert sum(admitted is not None for admitted in let_through) == 20
    later = limit.admit(("new",), 10)
    assert later is not None
    assert later.of_others > 4000  # the rest is still counted with its source


def test_remembered_sources_are_bounded_and_the_oldest_goes_first() -> None:
    limit = RateLimit(period_s=10, max_sources=2)
    for source in "abc":
        limit.admit((source,), 0)
    assert limit.admit(("c",), 1) is None
    assert limit.admit(("a",), 1) == Admitted()


def record(text: str, *args: object, level: int = logging.WARNING) -> logging.LogRecord:
    return logging.LogRecord("name", level, "file", 1, text, args, None)


def test_the_first_argument_is_the_source_and_what_was_held_back_is_said() -> None:
    times = iter((0, 0, 0, 10))
    held = RateLimitFilter(RateLimit(period_s=10), lambda: next(times))
    assert held.filter(record("%s: bad image: %s", "r1", "x"))
    assert not held.filter(record("%s: bad image: %s", "r1", "y"))
    assert held.filter(record("%s: bad image: %s", "r2", "x"))
    again = record("%s: bad image: %s", "r1", "z")
    assert held.filter(again)
    assert again.getMessage() == "r1: bad image: z (and 1 more like it)"


def test_a_clock_that_is_set_back_holds_nothing_back() -> None:
    held = RateLimitFilter(RateLimit(period_s=0.01))
    before, after = record("%s: bad image", "r1"), record("%s: bad image", "r1")
    after.created = before.created - 3_600
    assert held.filter(before)
    time.sleep(0.02)
    assert held.filter(after)


def test_information_is_never_held_back() -> None:
    held = RateLimitFilter(RateLimit(period_s=10))
    assert all(held.filter(record("%s is here", "r1", level=logging.INFO)) for _ in range(3))


def test_lines_go_to_where_stderr_points_when_they_are_written(monkeypatch: pytest.MonkeyPatch) -> None:
    handler = StderrHandler()
    redirected = io.StringIO()
    monkeypatch.setattr(sys, "stderr", redirected)
    handler.emit(record("here"))
    assert redirected.getvalue() == "here\n"


def test_what_a_peer_says_writes_no_line_and_no_colour_of_its_own() -> None:
    line = OneLine(FORMAT).format(record("%s left: caf\u00e9 \u2603", "http://a\n2026 ERROR fake\u2028\x1b[31m\r"))
    assert line.endswith("name: http://a\\n2026 ERROR fake\\u2028\\x1b[31m\\r left: caf\u00e9 \u2603")


def test_a_traceback_has_its_lines() -> None:
    with pytest.raises(ValueError, match="none") as raised:
        int("none")
    failed = (raised.type, raised.value, raised.tb)
    made = logging.LogRecord("name", logging.ERROR, "file", 1, "it failed", (), failed)
    first, *_, last = OneLine(FORMAT).format(made).splitlines()
    assert first.endswith("name: it failed")
    assert last == "ValueError: invalid literal for int() with base 10: 'none'"


def test_a_traceback_writes_no_colour_of_its_own() -> None:
    error = ValueError("\x1b[31m")
    made = logging.LogRecord("name", logging.ERROR, "file", 1, "it failed", (), (ValueError, error, None))
    assert OneLine(FORMAT).format(made).splitlines()[-1] == r"ValueError: \x1b[31m"


class Stuck(logging.Handler):
    """Writes nothing before it may. lines: what it wrote."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.may = threading.Event()

    def emit(self, record: logging.LogRecord) -> None:
        self.may.wait()
        self.lines.append(record.getMessage())


def test_nobody_waits_for_a_log_that_is_not_read_and_what_is_too_much_is_left_out() -> None:
    stuck = Stuck()
    beside = WriterThread(stuck)
    counted = [0]
    for number in range(2 * MAX_WAITING):
        counted[0] = number
        beside.handle(logging.LogRecord("name", logging.INFO, "file", 1, "no. %s", (counted,), None))
    stuck.may.set()
    beside.flush()
    assert stuck.lines[:2] == ["no. [0]", "no. [1]"]
    written = len(stuck.lines)
    assert MAX_WAITING <= written <= MAX_WAITING + 1
    beside.handle(record("read again"))
    beside.handle(record("and again"))
    beside.flush()
    counts = re.findall(r" \(and (\d+) events before it that nobody read\)", "\n".join(stuck.lines))
    assert sum(map(int, counts)) == 2 * MAX_WAITING - written
    assert stuck.lines[written].startswith("read again (and ")
    assert stuck.lines[written + 1 :] == ["and again"]


FORKING = """
import logging
import os
from services.toolbox import logs

logs.configure("info")
child = os.fork()
logging.getLogger("of the child" if child == 0 else "of the parent").info("here")
logging.shutdown()
if child == 0:
    os._exit(0)
os.waitpid(child, 0)
"""


def test_a_process_that_was_forked_writes_too() -> None:
    command = [sys.executable, "-c", FORKING]
    said = subprocess.run(command, check=True, stderr=subprocess.PIPE, text=True, timeout=60).stderr
    assert "of the child: here" in said
    assert "of the parent: here" in said


POSTING = """
import logging
from services.toolbox import logs

logs.configure("info")
logging.getLogger("httpx").info('HTTP Request: POST https://ops.example/secret "HTTP/1.1 200 OK"')
logging.getLogger("ours").info("here")
logging.shutdown()
"""


def test_posts_are_not_logged_one_by_one() -> None:
    command = [sys.executable, "-c", POSTING]
    said = subprocess.run(command, check=True, stderr=subprocess.PIPE, text=True, timeout=60).stderr
    assert said.count("\n") == 1
    assert "ours: here" in said
