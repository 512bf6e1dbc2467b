"""Which clock a process reads: times of two processes compare only when they read the same one."""

import socket
from pathlib import Path

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def clock_id() -> str:
    """Return a name for this machine's system clock, the same for every process and container on it."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return socket.gethostname()
