"""What a worker is called unless it is told."""

import os
import secrets
import socket


def default_worker_name() -> str:
    """Return a name no other worker has: the machine's, the process's, and, as containers share those, one by lot."""
    return f"{machine_name(socket.gethostname())}-{os.getpid()}-{secrets.token_hex(2)}"


def machine_name(host: str) -> str:
    """Return what of a host's name may stand in a key."""
    machine = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in host).strip("-")
    return machine[:50] or "worker"
