"""The processes that a measurement consists of, and what the system says about them."""

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Final

import psutil
import zenoh

from services.toolbox.demo.children import free_ports

ROS_PYTHON: Final = "/usr/bin/python3"
ROSMASTER: Final = "/usr/bin/rosmaster"
START_S: Final = 30.0
KEPT_LINES: Final = 1_000
_CPU_CLOCK: Final = 2
"""Linux's number for the precise one among a process's processor time clocks."""


class PeerError(Exception):
    """A process ended that was still needed; says which one and its last words."""


class Process:
    """A running process. What it says is read all the time, so that it never waits; the newest lines are kept."""

    def __init__(self, child: subprocess.Popen[str], errors: IO[bytes]) -> None:
        self._child = child
        self._errors = errors
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._child.stdout is not None  # noqa: S101 - it is a pipe
        with self._child.stdout as lines:
            for line in lines:
                with self._news:
                    self._lines.append(line)
                    self._news.notify()
        with self._news:
            self._lines.append("")
            self._news.notify()

    def join(self) -> None:
        """Wait until all that it said was read: it has ended."""
        self._reader.join(START_S)

    def ask(self) -> dict[str, Any]:
        """Return what a peer that answers says now.

        Raises:
            PeerError: it ended.
        """
        self.tell("")
        return self.answer()

    def tell(self, what: str) -> None:
        """Have a peer that obeys do something; it answers when it is done.

        Raises:
            PeerError: it ended.
        """
        assert self._child.stdin is not None  # noqa: S101 - it is a pipe
        try:
            self._child.stdin.write(f"{what}\n")
            self._child.stdin.flush()
        except OSError as error:
            raise PeerError(self.last_words()) from error

    def answer(self, within_s: float | None = None) -> dict[str, Any]:
        """Return its next answer.

        Raises:
            PeerError: it ended, or it said nothing within that time.
        """
        with self._news:
            said = self._news.wait_for(lambda: self._lines, within_s)
            line = self._lines.popleft() if said and self._lines[0] else ""
        try:
            answer: dict[str, Any] = json.loads(line)
        except ValueError as error:
            raise PeerError(self.last_words()) from error
        return answer

    @property
    def pid(self) -> int:
        """Its number."""
        return self._child.pid

    def cpu_s(self) -> float:
        """Return the user and system time so far."""
        return cpu_s(self.pid)

    def unscheduled_s(self) -> dict[str, float]:
        """Return for how long each of its threads was ready to run while others had the processors."""
        waited_s = {}
        for thread in Path(f"/proc/{self.pid}/task").iterdir():
            with suppress(OSError):  # it has just ended
                waited_s[thread.name] = int((thread / "schedstat").read_text().split()[1]) / 1e9
        return waited_s

    def rss_bytes(self) -> int:
        """Return the resident memory."""
        return int(psutil.Process(self._child.pid).memory_info().rss)

    def runs(self) -> bool:
        """Whether it has not ended."""
        return self._child.poll() is None

    def stop(self) -> None:
        """Let it stand still."""
        self._child.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Let it run on."""
        self._child.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it as a crash would."""
        self._child.kill()
        self._child.wait()

    def end(self) -> float:
        """Ask it to end; return how many seconds it took.

        Raises:
            PeerError: it did not end, or not in order.
        """
        asked = time.monotonic()
        self._child.terminate()
        try:
            code = self._child.wait(START_S)
        except subprocess.TimeoutExpired as error:
            raise PeerError(self.last_words()) from error
        if code:
            raise PeerError(self.last_words())
        return time.monotonic() - asked

    def last_words(self) -> str:
        """Return its command and the end of its standard error."""
        self._errors.seek(0)
        return f"{self._child.args!r} said: {self._errors.read().decode(errors='replace')[-2000:]}"


def cpu_s(pid: int) -> float:
    """Return a process's user and system time so far."""
    return time.clock_gettime(~pid << 3 | _CPU_CLOCK)


@contextmanager
def running(arguments: Sequence[str], master: str = "") -> Iterator[Process]:
    """Run a process, under ROS's own Python with Zenoh's package; end it on leaving. master: ROS's, if there is one."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as errors:
        package = Path(zenoh.__file__).parent
        (Path(folder) / package.name).symlink_to(package)
        environment = {"ROS_MASTER_URI": master, "ROS_IP": "127.0.0.1"}
        if arguments[0] == ROS_PYTHON:
            environment["PYTHONPATH"] = folder
        child = subprocess.Popen(
            arguments,
            env={**os.environ, **environment},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        process = Process(child, errors)
        try:
            yield process
        finally:
            process.go_on()
            assert child.stdin is not None  # noqa: S101 - it is a pipe
            with suppress(OSError):
                child.stdin.close()
            child.terminate()
            try:
                child.wait(timeout=5)
            except subprocess.TimeoutExpired:
                process.kill()
            process.join()


def module(name: str, *arguments: str) -> list[str]:
    """Return the command line of a peer."""
    return [sys.executable, "-m", f"benchmarks.peers.{name}", *arguments]


@contextmanager
def ros_master() -> Iterator[str]:
    """Run Debian's rosmaster on a free port; it answers by then."""
    port = free_ports(1)
    uri = f"http://127.0.0.1:{port}"
    with running([ROSMASTER, "--core", "-p", str(port)], uri):
        deadline = time.monotonic() + START_S
        while not _answers(port) and time.monotonic() < deadline:
            time.sleep(0.05)
        yield uri


def _answers(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
        return True
    return False
