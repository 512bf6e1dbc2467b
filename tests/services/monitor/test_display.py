"""The terminal display."""

import asyncio
import errno
import fcntl
import io
import logging
import os
import pty
import select
import signal
import subprocess
import sys

import pytest
from msgspec.structs import replace
from rich.console import Console

from bus import Bus, QoS, RequestError, open_bus
from schemas import codec, keys
from schemas.detections import ClassCount, ClassList
from schemas.inventory import InventoryAnswer
from schemas.keys import CameraKey, Stream
from services.monitor import display
from services.monitor.display import line, notes_of, render
from services.monitor.fleet import Age, Fleet, Row
from services.toolbox.demo.children import free_ports
from tests.bus.sessions import ROOT, client
from tests.services.monitor.inventory.seeing import FRONT, seen
from tests.waiting import PATIENCE_S, until

BUSY = Row(
    CameraKey("r1", "front"),
    online=True,
    classes=(ClassCount("box", 3, 0.9), ClassCount("pallet", 1, 0.5)),
    age=Age(0.24, exact=True),
    rate_hz=2.04,
)
LOST = Row(CameraKey("r2", "front"), online=False, classes=(), age=Age(9, exact=False), rate_hz=0)
NEW = Row(CameraKey("r3", "front"), online=True, classes=None, age=None, rate_hz=0)


def drawn(*rows: Row, notes: tuple[str, ...] = (), more: int = 0) -> str:
    console = Console(file=io.StringIO(), width=100)
    console.print(render(rows, notes, more))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_every_column_of_every_row() -> None:
    shown = [
        [cell.strip() for cell in row.split("│")[1:-1]] for row in drawn(BUSY, LOST, NEW).splitlines() if "│" in row
    ]
    assert shown == [
        ["r1", "front", "online", "3 box, 1 pallet", "0.2 s", "2.0/s"],
        ["r2", "front", "offline", "nothing", "> 9.0 s", "0.0/s"],
        ["r3", "front", "online", "waiting for class lists", "-", "0.0/s"],
    ]


def test_a_camera_that_nobody_speaks_for_is_silent_on_a_terminal_too() -> None:
    assert "silent" in drawn(replace(BUSY, age=Age(9, exact=True)))
    assert "silent" not in drawn(BUSY)


def test_an_empty_fleet_says_so_and_notes_are_shown() -> None:
    shown = drawn(notes=("listening on tcp/127.0.0.1:7447",))
    assert "no cameras yet" in shown
    assert "listening on tcp/127.0.0.1:7447" in shown


def test_names_are_never_markup() -> None:
    shady = Row(CameraKey("r1", "front"), online=True, classes=(ClassCount("[red]x[/red]", 1, 1),), age=None, rate_hz=0)
    assert "1 [red]x[/red]" in drawn(shady)


def test_plain_line() -> None:
    assert line(BUSY, "online") == "r1/front: online, 3 box, 1 pallet, age 0.2 s, 2.0/s"


def test_what_does_not_fit_is_counted() -> None:
    assert "and 1 more cameras" in drawn(BUSY, LOST, more=1)
    assert "more cameras" not in drawn(BUSY, LOST)


def test_what_was_left_out_is_said() -> None:
    assert notes_of({}) == []
    assert notes_of({"malformed messages": 3, "b": 1}) == ["left out: 1 b, 3 malformed messages"]


def test_a_models_names_write_nothing_but_themselves() -> None:
    hostile = Row(
        CameraKey("r1", "front"),
        online=True,
        classes=(ClassCount("\x1b[2Jbox\nr2/front: online", 1, 0.9),),
        age=None,
        rate_hz=0,
    )
    assert r": online, 1 \x1b[2Jbox\nr2/front: online, age" in line(hostile, "online")
    shown = drawn(hostile)
    assert r"\x1b[2Jbox\nr2/front" in shown
    assert "\x1b" not in shown


PAGE = 4096


def output(*, terminal: bool) -> tuple[int, int]:
    """Return the ends of what a process may write to: the one to read and the one to write."""
    if terminal:
        return pty.openpty()
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, PAGE)
    return reading, writing


async def class_lists(bus: Bus) -> int:
    """Return how many the monitor took in."""
    while True:
        try:
            reply = await bus.request(keys.INVENTORY, timeout_s=5)
        except RequestError:
            await asyncio.sleep(0.1)
        else:
            return codec.decode(InventoryAnswer, reply.payload, reply.encoding).class_lists


@pytest.mark.parametrize("terminal", [False, True], ids=["pipe", "terminal"])
async def test_a_monitor_whose_picture_nobody_reads_goes_on_and_ends_in_order(*, terminal: bool) -> None:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    reading, writing = output(terminal=terminal)
    monitor = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "services.toolbox", "monitor", "--listen", endpoint),
        *("--no-web", "--history", "none", "--refresh-s", "0.1"),
        cwd=ROOT,
        stdout=writing,
        env={**os.environ, "TERM": "xterm"},
    )
    key, encoding = FRONT.stream(Stream.CLASSES), codec.encoding(ClassList)
    try:
        async with asyncio.timeout(PATIENCE_S), open_bus(client(endpoint)) as bus:
            async with bus.publisher(key, QoS.RESULT, encoding=encoding) as publisher:
                put = 0
                while select.select([], [writing], [], 0)[1]:
                    put += 1
                    publisher.put(codec.encode(seen(put, {f"a class of no. {put // 2 % 9} and {'x' * 200}": 1})))
                    await asyncio.sleep(0.05)
                publisher.put(codec.encode(seen(put + 1, {})))
                before = await class_lists(bus)
                publisher.put(codec.encode(seen(put + 2, {"box": 1})))
                while await class_lists(bus) <= before:  # noqa: ASYNC110 - nobody tells
                    await asyncio.sleep(0.05)
            monitor.send_signal(signal.SIGTERM)
            assert await monitor.wait() == 0
    finally:
        if monitor.returncode is None:
            monitor.kill()
        await monitor.wait()
        os.close(reading)
        os.close(writing)


@pytest.mark.parametrize("terminal", [False, True], ids=["disk", "terminal"])
async def test_a_monitor_that_cannot_write_its_picture_goes_on_and_says_so_once(*, terminal: bool) -> None:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    if terminal:
        reading, writing = pty.openpty()
        os.close(reading)  # it has been closed: what is written to it fails
    else:
        writing = os.open("/dev/full", os.O_WRONLY)
    monitor = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "services.toolbox", "monitor", "--listen", endpoint),
        *("--no-web", "--history", "none", "--refresh-s", "0.1"),
        cwd=ROOT,
        stdout=writing,
        stderr=subprocess.PIPE,
        env={**os.environ, "TERM": "xterm", "TTY_COMPATIBLE": str(int(terminal))},
    )
    os.close(writing)
    assert monitor.stderr is not None
    try:
        async with asyncio.timeout(PATIENCE_S):
            said = await monitor.stderr.readline()
            async with open_bus(client(endpoint)) as bus:
                await class_lists(bus)
            monitor.send_signal(signal.SIGTERM)
            assert await monitor.wait() == 0
            rest = await monitor.stderr.read()
    finally:
        if monitor.returncode is None:
            monitor.kill()
        await monitor.wait()
    reason = "Input/output error" if terminal else "No space left on device"
    assert said.decode().endswith(f"the fleet is not shown until the output is writable: {reason}\n")
    assert rest == b""


class FullAtFirst(io.StringIO):
    """A file on a disk that is full until it is said to have room."""

    def __init__(self) -> None:
        super().__init__()
        self.refused = 0
        self.room = False

    def write(self, text: str) -> int:
        if not self.room:
            self.refused += 1
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(text)


async def test_the_picture_is_written_once_there_is_room_for_it(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(display, "AGAIN_S", 0.01)
    file = FullAtFirst()
    fleet = Fleet("a clock")
    showing = asyncio.ensure_future(display.show(fleet, Console(file=file), 0.01, note="where to join"))
    with caplog.at_level(logging.WARNING):
        await until(lambda: file.refused > 2)
        file.room = True
        await until(lambda: "where to join" in file.getvalue())
        assert len(caplog.records) == 1
        file.room = False
        fleet.camera_presence(FRONT, alive=True)
        await until(lambda: len(caplog.records) == 2)
    showing.cancel()
    with pytest.raises(asyncio.CancelledError):
        await showing


async def test_a_monitor_without_standard_output_ends_in_order() -> None:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    monitor = await asyncio.create_subprocess_exec(
        *("sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-m", "services.toolbox", "monitor"),
        *("--listen", endpoint, "--no-web", "--history", "none"),
        cwd=ROOT,
        stderr=subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(PATIENCE_S), open_bus(client(endpoint)) as bus:
            await class_lists(bus)
            monitor.send_signal(signal.SIGTERM)
            _, said = await monitor.communicate()
    finally:
        if monitor.returncode is None:
            monitor.kill()
        await monitor.wait()
    assert (monitor.returncode, said) == (0, b"")
