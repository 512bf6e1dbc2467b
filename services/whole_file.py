"""Files that are written complete or not at all, or loaded only if nobody else can have written them."""

import os
import stat
from pathlib import Path
from typing import Final


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


OTHERS_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH
FOLDER_MODE: Final = 0o755
"""Of folders that are made for such files, so that others write nothing there, whatever the umask."""


class NotOursError(Exception):
    """Somebody else can write a file or folder; the message names it, who can, and the cure."""


def check_ours(*paths: Path) -> None:
    """Check files and folders.

    Raises:
        NotOursError: another user than this one and root owns one, or its group or others may write it.
        OSError: one cannot be looked at.
    """
    for path in paths:
        found = path.stat()
        if found.st_uid not in (0, os.geteuid()):
            raise NotOursError(f"{path} belongs to another user (uid {found.st_uid}): give a folder of your own")
        if found.st_mode & OTHERS_WRITE:
            who = "everybody" if found.st_mode & stat.S_IWOTH else "its group"
            raise NotOursError(f"{path} can be written by {who} (mode {stat.S_IMODE(found.st_mode):o}): {_cure(path)}")


def _cure(path: Path) -> str:
    return f"chmod -R go-w {path}" if path.is_dir() else f"chmod go-w {path}"


def is_everybodys(path: Path) -> bool:
    """Whether everybody on this machine may write a file."""
    return bool(path.stat().st_mode & stat.S_IWOTH)


def keep_others_out(path: Path) -> None:
    """Take from all others the right to write a file or folder."""
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & OTHERS_WRITE:
        path.chmod(mode & ~OTHERS_WRITE)
