"""What a worker is called unless it is told."""

import os
import socket


def default_worker_name() -> str:
    """Return a name no other worker has: the machine's and the process's."""
    machine = "".join(letter if letter.isalnum() else "-" for letter in socket.gethostname()).strip("-")
    return f"{machine[:48] or 'worker'}-{os.getpid()}"
