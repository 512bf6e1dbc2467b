"""Robots as a monitor hears them. Arguments: router, number of the first robot, their sessions, robots in a row on one.

Every robot has one camera; both are present, as a gateway says it, and its class lists are published as a detector
publishes them: those of a session's robots one after the other. What is in view changes every ten seconds or so.

Obeys `robots N`: from then on there are so many. `send HZ SECONDS`: class lists, spread evenly, from all of them. Says
how many there were and how late the latest was handed to Zenoh.
"""

import asyncio
import gc
import sys
import time
import uuid
from collections.abc import Mapping
from contextlib import AsyncExitStack
from typing import Final

from benchmarks.peers.answering import obey
from bus import Bus, BusSettings, Publisher, QoS, open_bus
from schemas import codec, keys
from schemas.detections import KEPT_LISTS, ClassCount, ClassList
from schemas.header import Header
from schemas.keys import CameraKey, Stream

TURN_S: Final = 0.005
COMING_S: Final = 0.04
"""Between two robots that come: whoever switches all of them on at once finds out what declaring costs, and no more."""

CHANGE_S: Final = 10

BOOT_ID: Final = uuid.uuid4().hex


class Robot:
    """One robot's camera."""

    def __init__(self, key: CameraKey, number: int, publisher: Publisher) -> None:
        self._key = key
        self._number = number
        self._publisher = publisher
        self._seq = 0

    @property
    def sent(self) -> int:
        """How many lists the link took."""
        return self._publisher.counts.put - self._publisher.counts.dropped

    def send(self) -> None:
        """Publish what is in view now."""
        self._seq += 1
        self._publisher.put(codec.encode(self._seen(time.time_ns())))

    def _seen(self, now_ns: int) -> ClassList:
        turn = now_ns // 1_000_000_000 + self._number
        classes = [ClassCount("box", 2 + turn // CHANGE_S % 2, 0.91), ClassCount("forklift", 1, 0.74)]
        if turn // (2 * CHANGE_S) % 2:
            classes.append(ClassCount("pallet", 1, 0.83))
        header = Header(
            robot=self._key.robot,
            camera=self._key.camera,
            boot_id=BOOT_ID,
            seq=self._seq,
            stamp_ns=now_ns,
            frame_id="camera_color_optical_frame",
            received_ns=now_ns,
        )
        spans = {"queue": 1_200_000, "model": 21_000_000}
        return ClassList(header=header, classes=classes, model="warehouse-n-seg", worker="worker-1", spans=spans)


class Fleet:
    """The robots of this process."""

    def __init__(self, buses: list[Bus], stack: AsyncExitStack, first: int, share: int) -> None:
        self._buses = buses
        self._share = share
        self._stack = stack
        self._first = first
        self._robots: list[Robot] = []

    async def obey(self, line: str) -> Mapping[str, object]:
        """Do what a line says."""
        match line.split():
            case ["robots", number]:
                await self._grow(int(number))
                return {"robots": len(self._robots)}
            case ["send", hz, seconds]:
                before = self._sent()
                late_s = await self._send(float(hz), float(seconds))
                return {"sent": self._sent() - before, "late_ms": round(late_s * 1e3, 1)}
        raise ValueError(f"cannot do {line!r}")

    def _sent(self) -> int:
        return sum(robot.sent for robot in self._robots)

    async def _grow(self, number: int) -> None:
        while len(self._robots) < number:
            index = len(self._robots)
            bus, key = (
                self._buses[index // self._share % len(self._buses)],
                CameraKey(f"r{self._first + index}", "front"),
            )
            await self._stack.enter_async_context(bus.announce(keys.robot_alive(key.robot)))
            await self._stack.enter_async_context(bus.announce(key.alive(Stream.COLOR)))
            publisher = await self._stack.enter_async_context(
                bus.publisher(
                    key.stream(Stream.CLASSES), QoS.RESULT, encoding=codec.encoding(ClassList), kept=KEPT_LISTS
                )
            )
            self._robots.append(Robot(key, self._first + index, publisher))
            await asyncio.sleep(COMING_S)
        gc.collect()
        gc.freeze()  # else all stand still for a quarter of a second while a thousand robots are looked through

    async def _send(self, hz: float, seconds: float) -> float:
        """Send; return how late the latest was."""
        began_s, done, late_s = time.monotonic(), 0, 0.0
        rate = hz * len(self._robots)
        total = round(rate * seconds)
        while done < total:
            due = min(total, int((time.monotonic() - began_s) * rate) + 1)
            for number in range(done, due):
                self._robots[number % len(self._robots)].send()
            late_s = max(late_s, time.monotonic() - began_s - done / rate)
            done = due
            await asyncio.sleep(TURN_S)
        return late_s


async def run(router: str, first: int, sessions: int, share: int) -> None:
    """Obey until the standard input ends."""
    settings = BusSettings(connect=[router], shared_memory=False)
    loop = asyncio.get_running_loop()
    async with AsyncExitStack() as stack:
        buses = [await stack.enter_async_context(open_bus(settings)) for _ in range(sessions)]
        fleet = Fleet(buses, stack, first, share)
        await asyncio.to_thread(obey, lambda line: asyncio.run_coroutine_threadsafe(fleet.obey(line), loop).result())


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1], *map(int, sys.argv[2:])))
