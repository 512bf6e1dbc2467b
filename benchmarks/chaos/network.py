"""A network namespace of this benchmark's own, and the robot's beside it: the machine's network stays as it is."""

import asyncio
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import msgspec

from benchmarks.chaos.link import addresses, ip
from benchmarks.chaos.shaper import Conditions
from benchmarks.gateway.processes import START_S, Process, running

INSIDE: Final = "CHAOS_NAMESPACE"
"""An environment variable that tells that this process is in a namespace of its own already."""


def has_namespaces() -> bool:
    """Whether networks can be separated here: it takes root, iproute2, util-linux and TUN devices."""
    tools = all(shutil.which(name) for name in ("ip", "unshare", "nsenter"))
    return os.geteuid() == 0 and tools and Path("/dev/net/tun").exists()


def is_apart() -> bool:
    """Whether this process is in namespaces of its own."""
    return os.environ.get(INSIDE) == str(os.getpid())


def enter_namespace(module: str, arguments: Sequence[str]) -> None:
    """Become the same program in a network and a mount namespace of its own; return there."""
    if is_apart():
        ip("link", "set", "lo", "up")
        return
    os.environ[INSIDE] = str(os.getpid())
    os.execvp("unshare", ["unshare", "--net", "--mount", sys.executable, "-m", module, *arguments])  # noqa: S606


class Network:
    """The robot's network namespace, and the link from there to here. address: of this end."""

    def __init__(self, stack: ExitStack) -> None:
        holder = stack.enter_context(running(["unshare", "--net", "sleep", "infinity"]))
        self._own = Path("/proc/self/ns/net").stat().st_ino
        self.prefix = ["nsenter", "--target", str(holder.pid), "--net"]
        self._holder = holder
        self._stack = stack
        self.address, _ = addresses(0)

    async def open(self) -> None:
        """Bring the robot's network up."""
        async with asyncio.timeout(START_S):
            while Path(f"/proc/{self._holder.pid}/ns/net").stat().st_ino == self._own:  # noqa: ASYNC110, ASYNC240
                await asyncio.sleep(0.01)
        ip("link", "set", "lo", "up", at=self._holder.pid)
        command = [sys.executable, "-m", "benchmarks.chaos.link", str(self._holder.pid), "0"]
        self._link: Process = self._stack.enter_context(running(command))
        await asyncio.to_thread(self._link.ask)

    def set(self, **conditions: object) -> None:
        """Give the link another state; see `Conditions`."""
        self._link.tell(msgspec.json.encode(Conditions(**conditions)).decode())  # type: ignore[arg-type]
        self._link.answer(START_S)


def mount_disk(folder: Path, mib: int) -> None:
    """Make a file system of its own, in memory, of so many MiB."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={mib}m,mode=755", "chaos", str(folder)], check=True)


def unmount_disk(folder: Path) -> None:
    """Take that file system away again, also while something is still open on it."""
    subprocess.run(["umount", "--lazy", str(folder)], check=True)
