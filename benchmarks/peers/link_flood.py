"""Floods that are no messages: presence, requests, the beginning of a message, and idle web connections.

Command line: kind of flood (see FLOODS), the router's endpoint or the page's host:port, seconds. Prints how much it
sent.
"""

import asyncio
import itertools
import json
import resource
import socket
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from benchmarks.peers.flood import named
from bus.api import MAX_REQUEST_BYTES
from bus.presence.token_lists import list_keys
from bus.session.config import session_config
from bus.settings import BusSettings
from schemas import keys
from schemas.keys import Stream

TOKENS: Final = 25_000
"""Cameras, more than the monitor follows; a link takes about a thousand in a second, and ever fewer."""

CAMERAS_LISTED: Final = 300
"""In one list, which has room for 8,000 characters."""

LISTS: Final = 60
"""Of one robot: more tokens than are followed."""

HALF_BYTES: Final = 120 << 20
"""Of a message: a little less than a router takes in."""

LEFT_OUT_BYTES: Final = 1 << 20
ADDRESSES: Final = 200
OPEN_AT_ONCE: Final = 2_000
"""Connections that are kept open: more than a page takes, 1,050."""


def session(endpoint: str) -> Any:
    """Return a session of Zenoh's own."""
    settings = BusSettings(connect=[endpoint], shared_memory=False)
    return zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(settings))))


def tokens(endpoint: str, seconds: float) -> dict[str, Any]:
    """Show the presence of ever more invented robots, each with a camera, and keep it."""
    until_s, size, shown = time.monotonic() + seconds, 0, 0
    with session(endpoint) as opened, ExitStack() as stack:
        for number in range(TOKENS):
            camera = named(number)
            for key in (keys.robot_alive(camera.robot), camera.alive(Stream.COLOR)):
                stack.callback(opened.liveliness().declare_token(key).undeclare)
                size, shown = size + len(key), shown + 1
            if time.monotonic() > until_s:
                break
        time.sleep(max(0.0, until_s - time.monotonic()))
        stack.pop_all()  # they end with the session
    return {"sent": shown, "sent_mb": round(size / 2**20, 1)}


def listed(endpoint: str, seconds: float) -> dict[str, Any]:
    """Show lists of presence tokens of ever more invented robots with very many cameras, and keep them."""
    until_s, size, shown = time.monotonic() + seconds, 0, 0
    with session(endpoint) as opened, ExitStack() as stack:
        while time.monotonic() < until_s:
            robot = keys.robot_alive(f"invented{shown // CAMERAS_LISTED // LISTS}")
            cameras = range(shown, shown + CAMERAS_LISTED)
            (key,) = list_keys(
                robot.rpartition("/")[0], [robot.replace("/alive", f"/{n}/color/alive") for n in cameras]
            )
            stack.callback(opened.liveliness().declare_token(key).undeclare)
            size, shown = size + len(key), shown + CAMERAS_LISTED
        stack.pop_all()  # they end with the session
    return {"sent": shown, "sent_mb": round(size / 2**20, 1)}


def requests(endpoint: str, seconds: float) -> dict[str, Any]:
    """Send the largest questions about the inventory one after the other, and wait for no answer."""
    until_s, sent = time.monotonic() + seconds, 0
    with session(endpoint) as opened:
        while time.monotonic() < until_s:
            opened.get(
                keys.INVENTORY, Callback(_ignore, indirect=False), payload=bytes(MAX_REQUEST_BYTES), timeout=60.0
            )
            sent += 1
    return {"sent": sent, "sent_mb": round(sent * MAX_REQUEST_BYTES / 2**20, 1)}


def _ignore(_: zenoh.Reply) -> None:
    pass


def halves(endpoint: str, seconds: float) -> dict[str, Any]:
    """Send most of a large message, and no more on its link for as long as its router waits."""
    return asyncio.run(_halves(endpoint, seconds))


async def _halves(endpoint: str, seconds: float) -> dict[str, Any]:
    host, port = endpoint.partition("/")[2].rsplit(":", 1)
    passed = 0

    async def hand_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, most: int) -> None:
        nonlocal passed
        left = most
        with suppress(ConnectionError):
            while left > 0 and (data := await reader.read(min(left, 1 << 16))):
                writer.write(data)
                await writer.drain()
                left -= len(data)
                passed += len(data) if most < sys.maxsize else 0
            await asyncio.Event().wait()

    async def connect(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        to_reader, to_writer = await asyncio.open_connection(host, int(port))
        both = (hand_on(reader, to_writer, HALF_BYTES - LEFT_OUT_BYTES), hand_on(to_reader, writer, sys.maxsize))
        with suppress(asyncio.CancelledError):
            await asyncio.gather(*both)

    async with await asyncio.start_server(connect, "127.0.0.1", 0) as server:
        near = f"tcp/127.0.0.1:{server.sockets[0].getsockname()[1]}"
        sending = asyncio.create_task(asyncio.to_thread(_send_much, near, seconds))
        await asyncio.sleep(seconds)
        for task in asyncio.all_tasks() - {asyncio.current_task(), sending}:
            task.cancel()
        await sending
    return {"sent": 1, "sent_mb": round(passed / 2**20, 1)}


def _send_much(endpoint: str, seconds: float) -> None:
    ended_s = time.monotonic() + seconds
    opened = session(endpoint)
    opened.put(named(0).stream(Stream.COLOR), bytes(HALF_BYTES), congestion_control=zenoh.CongestionControl.BLOCK)
    time.sleep(max(0.0, ended_s - time.monotonic()))
    with suppress(zenoh.ZError):
        opened.close()


def connections(page: str, seconds: float) -> dict[str, Any]:
    """Open connections to a page from many addresses, say nothing on them, and make up for those that are closed."""
    host, port = page.rsplit(":", 1)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 2 * OPEN_AT_ONCE)), hard))
    until_s, made = time.monotonic() + seconds, 0
    kept: list[socket.socket] = []
    for number in itertools.count():
        if time.monotonic() > until_s:
            break
        own = f"127.1.{number % ADDRESSES // 100}.{1 + number % 100}"
        with suppress(OSError):
            kept.append(socket.create_connection((host, int(port)), timeout=1, source_address=(own, 0)))
            made += 1
        if len(kept) > OPEN_AT_ONCE:
            kept.pop(0).close()
    for each in kept:
        each.close()
    return {"sent": made, "sent_mb": 0.0}


FLOODS: Final[dict[str, Callable[[str, float], dict[str, Any]]]] = {
    "tokens": tokens,
    "listed": listed,
    "requests": requests,
    "halves": halves,
    "connections": connections,
}


def main() -> None:
    """Flood."""
    kind, at, seconds = sys.argv[1], sys.argv[2], float(sys.argv[3])
    print(json.dumps(FLOODS[kind](at, seconds)), flush=True)


if __name__ == "__main__":
    main()
