import contextlib
import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE

import pytest

INTERVAL_S = 0.4
RUNNING = """
    import asyncio, os, signal, time
    from services.toolbox import process

    async def main():
        asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, time.sleep, 2.5)
        await asyncio.sleep(0.1)
        print(sorted(name for name in os.environ if name.startswith(("NOTIFY", "WATCHDOG"))), flush=True)
        await asyncio.sleep(60)

    process.leave(process.run(main))
"""

BEATING = """
    import asyncio, sys
    from services import service_manager
    from services.toolbox import process

    async def main():
        await asyncio.sleep(0.1)
        print(flush=True)
        problems = ["no link"]
        asyncio.create_task(service_manager.say_serving(lambda: "".join(problems)))
        await asyncio.to_thread(sys.stdin.readline)
        problems.clear()
        await asyncio.sleep(60)

    service_manager.HEARTBEAT_S = 0.05
    process.leave(process.run(main))
"""


class Manager:
    """Plays systemd: has a socket, starts a process, hears what it reports."""

    def __init__(self, heard: socket.socket, address: str) -> None:
        self._heard = heard
        self._address = address

    def start(self, *, interval_s: float = 0, watched: str = "") -> subprocess.Popen[str]:
        environment = {**os.environ, "NOTIFY_SOCKET": self._address, "WATCHDOG_USEC": f"{interval_s * 1e6:.0f}"}
        environment |= {"WATCHDOG_PID": watched} if watched else {}
        command = [sys.executable, "-c", textwrap.dedent(RUNNING)]
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)

    def next(self, within_s: float = 20) -> str:
        self._heard.settimeout(within_s)
        return self._heard.recv(100).decode()

    def rest(self, within_s: float) -> Iterator[str]:
        """Yield what is heard until nothing comes for so long."""
        with contextlib.suppress(TimeoutError):
            while True:
                yield self.next(within_s)


@pytest.fixture(params=["in the file system", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    address = str(tmp_path / "notify") if request.param == "in the file system" else f"@fleetsight-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(address.replace("@", "\0", 1))
        yield Manager(heard, address)


def test_it_is_told_that_the_process_runs_and_that_it_stops(manager: Manager) -> None:
    with manager.start() as child:
        assert manager.next() == "READY=1"
        with pytest.raises(TimeoutError):
            manager.next(2 * INTERVAL_S)
        child.terminate()
        assert manager.next() == "STOPPING=1"
    assert child.returncode == 0


def test_it_is_told_again_and_again_until_the_process_stands_still(manager: Manager) -> None:
    with manager.start(interval_s=INTERVAL_S) as child:
        assert [manager.next() for _ in range(4)] == ["READY=1", *["WATCHDOG=1"] * 3]
        child.send_signal(signal.SIGSTOP)
        assert len(list(manager.rest(3 * INTERVAL_S))) <= 1, "what was on its way"
        child.send_signal(signal.SIGCONT)
        assert manager.next() == "WATCHDOG=1"
        child.terminate()
    assert child.returncode == 0


def test_it_hears_nothing_while_something_holds_up_the_event_loop(manager: Manager) -> None:
    with manager.start(interval_s=INTERVAL_S) as child:
        assert child.stdout is not None
        assert manager.next() == "READY=1"
        child.stdout.readline()
        child.send_signal(signal.SIGUSR1)
        assert len(list(manager.rest(3 * INTERVAL_S))) <= 5, "what was on its way"
        assert manager.next() == "WATCHDOG=1", "it goes on"
        child.terminate()
    assert child.returncode == 0


def test_children_do_not_speak_for_the_process(manager: Manager) -> None:
    with manager.start(interval_s=INTERVAL_S) as child:
        assert child.stdout is not None
        assert manager.next() == "READY=1"
        assert child.stdout.readline() == "[]\n"
        child.terminate()


def test_a_watchdog_of_another_process_hears_nothing(manager: Manager) -> None:
    with manager.start(interval_s=INTERVAL_S, watched="1") as child:
        assert manager.next() == "READY=1"
        with pytest.raises(TimeoutError):
            manager.next(3 * INTERVAL_S)
        child.terminate()


@contextlib.contextmanager
def beating(heartbeat: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a process with a heartbeat; it has a link once it has read a line."""
    environment = {**os.environ, "FLEETSIGHT_HEARTBEAT_FILE": str(heartbeat)}
    command = [sys.executable, "-c", textwrap.dedent(BEATING)]
    with subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True, env=environment) as child:
        assert child.stdout is not None
        child.stdout.readline()
        yield child
        child.terminate()
        assert child.wait(20) == 0


def test_a_file_is_touched_again_and_again_while_the_event_loop_turns(tmp_path: Path) -> None:
    heartbeat = tmp_path / "heartbeat"
    with beating(heartbeat) as child:
        os.utime(heartbeat, (0, 0))
        while not heartbeat.stat().st_mtime:
            assert child.poll() is None
            time.sleep(0.01)


def test_the_file_says_when_the_process_has_begun_to_serve_over_a_link(tmp_path: Path) -> None:
    heartbeat = tmp_path / "heartbeat"
    with beating(heartbeat) as child:
        time.sleep(1)
        assert heartbeat.read_text(encoding="ascii") == "starting\n"
        assert child.stdin is not None
        child.stdin.write("\n")
        child.stdin.flush()
        while heartbeat.read_text(encoding="ascii") != "serving\n":
            assert child.poll() is None
            time.sleep(0.01)


def test_a_file_that_cannot_be_touched_is_named(tmp_path: Path) -> None:
    environment = {**os.environ, "FLEETSIGHT_HEARTBEAT_FILE": str(tmp_path / "missing" / "heartbeat")}
    command = [sys.executable, "-c", textwrap.dedent(RUNNING)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as child:
        assert child.stdout is not None
        child.stdout.readline()
        child.terminate()
        _, said = child.communicate(timeout=20)
    assert "heartbeat cannot be written: No such file or directory; name a file in a writable folder" in said
    assert child.returncode == 0
