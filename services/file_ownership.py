"""Files that are loaded only if nobody else can have written them: of this user or root, and writable by no others."""

from __future__ import annotations

import os
import stat
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

OTHERS_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH
FOLDER_MODE: Final = 0o755
"""Of folders that are made for such files: whatever the umask says, others write nothing there."""


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
