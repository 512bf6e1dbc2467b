import asyncio
import fcntl
import os
import pty
import select
import signal
import sys

import pytest

from bus import Bus, QoS, RequestError, open_bus
from schemas import codec, keys
from schemas.detections import ClassList
from schemas.inventory import InventoryAnswer
from schemas.keys import Stream
from services.toolbox.demo.ports import free_ports
from tests.bus.sessions import ROOT, client
from tests.contract.waiting import PATIENCE_S
from tests.services.monitor.inventory.seeing import FRONT, seen

PAGE = 4096


def outlet(*, terminal: bool) -> tuple[int, int]:
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
    reading, writing = outlet(terminal=terminal)
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
