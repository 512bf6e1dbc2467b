"""The limit of open files: each link of the process is one."""

import resource
from contextlib import suppress
from typing import Final

MOST_FILES: Final = 65_536
"""Highest limit to set: some systems allow a billion, and programs that close all files would take forever."""


def raise_file_limit() -> int:
    """Raise the soft limit of open files (`ulimit -n`) to the hard one, at most MOST_FILES; return the new limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = min(_finite(hard), MOST_FILES)
    if wanted > _finite(soft):
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return _finite(resource.getrlimit(resource.RLIMIT_NOFILE)[0])


def _finite(limit: int) -> int:
    return MOST_FILES if limit == resource.RLIM_INFINITY else limit
