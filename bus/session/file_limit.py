"""How many files this process may open: each of its links is one."""

import resource
from contextlib import suppress
from typing import Final

MOST_FILES: Final = 65_536
"""More than any process here needs; some systems allow a billion, and programs that close all of them take for ever."""


def raise_file_limit() -> int:
    """Raise the limit of open files (`ulimit -n`) to the hard one, MOST_FILES at most; return what it is then."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = min(_finite(hard), MOST_FILES)
    if wanted > _finite(soft):
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return _finite(resource.getrlimit(resource.RLIMIT_NOFILE)[0])


def _finite(limit: int) -> int:
    return MOST_FILES if limit == resource.RLIM_INFINITY else limit
