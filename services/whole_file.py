"""Writes files complete or not at all."""

from pathlib import Path


def write_whole(file: Path, content: bytes) -> None:
    """Write a file so that nobody ever reads a part of it; its folder is made where it is missing.

    Raises:
        OSError: it cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_suffix(".part")
    partial.write_bytes(content)
    partial.replace(file)
