"""Writes files complete or not at all."""

import os
from pathlib import Path


def write_whole(file: Path, content: bytes, *, durable: bool = False) -> None:
    """Write a file so that nobody ever reads a part of it; its folder is made where it is missing.

    durable: once this returns, the file survives a power cut; it waits for the disk.

    Raises:
        OSError: it cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_suffix(".part")
    with partial.open("wb") as written:
        written.write(content)
        if durable:
            written.flush()
            os.fsync(written.fileno())
    partial.replace(file)
    if durable:
        _sync_folder(file.parent)


def _sync_folder(folder: Path) -> None:
    """Wait until the names of a folder's files are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
