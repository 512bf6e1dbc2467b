"""A network link between this network namespace and another: IP packets pass through this process, or do not.

Arguments: a process in the other namespace, and the link's number from 0. This end has the address 10.77.NUMBER.1, the
other one 10.77.NUMBER.2. A line with `Conditions` in JSON changes the link's state and is answered with the packets
that passed and those lost. It takes root, /dev/net/tun and iproute2, and no kernel module for loss and delay.
"""

import asyncio
import fcntl
import heapq
import itertools
import os
import struct
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Final

import msgspec

from benchmarks.chaos.shaper import Conditions, Shaper
from benchmarks.peers.answering import obey

TUNSETIFF: Final = 0x400454CA
IFF_TUN_NO_PI: Final = 0x1001
MTU: Final = 1_500


def addresses(number: int) -> tuple[str, str]:
    """Return the addresses of this end and of the other one."""
    return f"10.77.{number}.1", f"10.77.{number}.2"


def open_tun(name: str) -> int:
    """Make a TUN device in this namespace; return what reads and writes its packets."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH14x", name.encode(), IFF_TUN_NO_PI))
    return device


def ip(*arguments: str, at: int | None = None) -> None:
    """Configure the network here, or in the namespace of a process."""
    there = ["nsenter", "--target", str(at), "--net"] if at is not None else []
    subprocess.run([*there, "ip", *arguments], check=True)


def set_up(name: str, address: str, other: str, at: int | None = None) -> None:
    """Give a device its address, and the route to the other end."""
    ip("address", "add", address, "peer", other, "dev", name, at=at)
    ip("link", "set", name, "mtu", str(MTU), "up", at=at)


class Direction:
    """Carries packets from one device to another."""

    def __init__(self, loop: asyncio.AbstractEventLoop, source: int, sink: int) -> None:
        self.shaper = Shaper()
        self.passed = 0
        self._loop = loop
        self._source = source
        self._sink = sink
        self._waiting: list[tuple[float, int, bytes]] = []
        self._order = itertools.count()
        self._timer: asyncio.TimerHandle | None = None
        loop.add_reader(source, self._read)

    def _read(self) -> None:
        while True:
            try:
                packet = os.read(self._source, 1 << 16)
            except BlockingIOError:
                break
            leaves_s = self.shaper.leaves_s(packet, time.monotonic()) if packet[0] >> 4 == 4 else None
            if leaves_s is not None:
                heapq.heappush(self._waiting, (leaves_s, next(self._order), packet))
        self._write()

    def _write(self) -> None:
        now_s = time.monotonic()
        while self._waiting and self._waiting[0][0] <= now_s:
            _, _, packet = heapq.heappop(self._waiting)
            try:
                os.write(self._sink, packet)
                self.passed += 1
            except OSError:  # the other end's device has no room, or is going
                self.shaper.lost += 1
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        if self._waiting:
            self._timer = self._loop.call_later(max(0.0, self._waiting[0][0] - now_s), self._write)


async def carry(process: int, number: int) -> None:
    """Carry packets until the standard input ends."""
    loop = asyncio.get_running_loop()
    here, there = f"chaos{number}a", f"chaos{number}b"
    devices = open_tun(here), open_tun(there)
    ip("link", "set", there, "netns", str(process))
    near, far = addresses(number)
    set_up(here, near, far)
    set_up(there, far, near, at=process)
    ways = [Direction(loop, *devices), Direction(loop, *reversed(devices))]

    def change(line: str) -> Mapping[str, object]:
        for way in ways if line else ():
            way.shaper.conditions = msgspec.json.decode(line, type=Conditions)
        return {"passed": [way.passed for way in ways], "lost": [way.shaper.lost for way in ways]}

    await asyncio.to_thread(obey, change)


if __name__ == "__main__":
    asyncio.run(carry(int(sys.argv[1]), int(sys.argv[2])))
