"""What a worker is called unless it is told."""

import os
import secrets
import socket


def default_worker_name() -> str:
    """Return a name no other worker has: the machine's, the process's, and, as containers share those, one by lot."""
    machine = "".join(letter if letter.isalnum() else "-" for letter in socket.gethostname()).strip("-")
    return f"{machine[:50] or 'worker'}-{os.getpid()}-{secrets.token_hex(2)}"
