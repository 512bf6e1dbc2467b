"""Tells systemd, by sd_notify(3), and others, by a file, that this process runs and that its event loop still turns."""

import asyncio
import contextlib
import logging
import os
import socket
import threading
from collections.abc import Callable, MutableMapping
from pathlib import Path
from typing import Final

MICROSECONDS: Final = 1_000_000
SOCKET: Final = "NOTIFY_SOCKET"
INTERVAL: Final = "WATCHDOG_USEC"
WATCHED: Final = "WATCHDOG_PID"
HEARTBEAT: Final = "FLEETSIGHT_HEARTBEAT_FILE"
HEARTBEAT_S: Final = 5.0
STARTING: Final = "starting\n"
SERVING: Final = "serving\n"

LOOK_S: Final = 0.5
"""Interval at which a process without a link looks for one."""

_serving: Final = threading.Event()

log = logging.getLogger(__name__)


async def report(environment: MutableMapping[str, str] = os.environ) -> None:
    """Report READY=1, then WATCHDOG=1 twice per interval that the manager waits for, and STOPPING=1 when cancelled.

    Returns at once where no manager listens. The manager's variables are removed from the environment, because child
    processes must not speak for this one.
    """
    address = environment.pop(SOCKET, "")
    interval_s = int(environment.pop(INTERVAL, "0")) / MICROSECONDS
    watched = environment.pop(WATCHED, "")
    if not address:
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as manager:

        def say(state: bytes) -> None:
            with contextlib.suppress(OSError):  # the manager restarts, or does not read: it asks for no more
                manager.sendto(state, address.replace("@", "\0", 1) if address.startswith("@") else address)

        say(b"READY=1")
        try:
            if not interval_s or watched not in ("", str(os.getpid())):
                await asyncio.Event().wait()
            while True:
                say(b"WATCHDOG=1")
                await asyncio.sleep(interval_s / 2)
        finally:
            say(b"STOPPING=1")


async def touch_heartbeat(environment: MutableMapping[str, str] = os.environ) -> None:
    """Write STARTING or SERVING to the file named by FLEETSIGHT_HEARTBEAT_FILE every HEARTBEAT_S seconds.

    Probes of containers look at its time, and at what it says. Returns at once where none is named. The variable is
    removed from the environment, as in `report`.
    """
    path, said = environment.pop(HEARTBEAT, ""), ""
    while path:
        says = SERVING if _serving.is_set() else STARTING
        _touch(Path(path), "" if says == said else says)
        said = says
        await asyncio.sleep(HEARTBEAT_S)


async def say_serving(link_problem: Callable[[], str]) -> None:
    """Note that this process does its work, once it has a link: a worker has its model and shares cameras with others.

    link_problem: returns why there is none, or nothing.
    """
    while link_problem():  # noqa: ASYNC110 - nobody tells
        await asyncio.sleep(LOOK_S)
    _serving.set()


def _touch(file: Path, text: str) -> None:
    """Write a text to a file, or set its time if there is none to write."""
    try:
        if text:
            file.write_text(text, encoding="ascii")
        else:
            file.touch()
    except OSError as error:
        log.warning("%s: %s cannot be written: %s; name a file in a writable folder", HEARTBEAT, file, error.strerror)
