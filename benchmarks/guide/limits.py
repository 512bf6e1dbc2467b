"""What a hop cannot be quicker than: the same bytes copied in memory, through loopback TCP, and put on Zenoh alone."""

import asyncio
import socket
import statistics
import threading
import time
from typing import Final

from bus import LATEST, BusSettings, Publisher, QoS, Subscription, open_bus

REPEATS: Final = 15
KEY: Final = "benchmark/link"
APART_S: Final = 0.05
LOST_S: Final = 2.0
MS: Final = 1e-6


def memcpy_ms(size: int) -> float:
    """Return how long it takes to copy so many bytes."""
    source, sink = bytes(size), bytearray(size)
    took = []
    for _ in range(REPEATS):
        began_ns = time.perf_counter_ns()
        sink[:] = source
        took.append(time.perf_counter_ns() - began_ns)
    return statistics.median(took) * MS


def tcp_ms(size: int) -> float:
    """Return how long so many bytes take from a socket to another one of this machine."""
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        socket.create_connection(listener.getsockname()) as near,
        listener.accept()[0] as far,
    ):
        near.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return statistics.median(_crossing_ms(near, far, bytes(size)) for _ in range(REPEATS))


def _crossing_ms(near: socket.socket, far: socket.socket, payload: bytes) -> float:
    sending = threading.Thread(target=near.sendall, args=(payload,))
    began_ns = time.perf_counter_ns()
    sending.start()
    far.recv_into(bytearray(len(payload)), 0, socket.MSG_WAITALL)
    took_ns = time.perf_counter_ns() - began_ns
    sending.join()
    return took_ns * MS


async def link_ms(endpoint: str, size: int) -> float:
    """Return how long so many bytes take from one session to another through a router, with nothing else on it.

    Raises:
        TimeoutError: none arrived. A machine that is busy loses some.
    """
    settings = BusSettings(connect=[endpoint])
    async with (
        open_bus(settings) as near,
        open_bus(settings) as far,
        far.subscribe(KEY, LATEST, history=False) as samples,
        near.publisher(KEY, QoS.IMAGE) as publisher,
    ):
        async with asyncio.timeout(LOST_S):
            while not publisher.wanted:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(APART_S)
        took = [ms for number in range(REPEATS) if (ms := await _put_ms(publisher, samples, number, size)) is not None]
    if not took:
        raise TimeoutError(f"nothing of {size} bytes came through {endpoint}")
    return statistics.median(took)


async def _put_ms(publisher: Publisher, samples: Subscription, number: int, size: int) -> float | None:
    await asyncio.sleep(APART_S)
    payload = number.to_bytes(1) + bytes(size - 1)
    began_ns = time.time_ns()
    publisher.put(payload)
    try:
        async with asyncio.timeout(LOST_S):
            async for sample in samples:
                if sample.payload[0] == number:
                    return (sample.received_ns - began_ns) * MS
    except TimeoutError:
        pass
    return None
