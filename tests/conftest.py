from __future__ import annotations

import asyncio
import gc
import logging
import os
import tempfile
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# No test asserts how long anything takes, on machines that do many things at once least of all.
settings.register_profile("fleetsight", deadline=None)
settings.load_profile("fleetsight")

STALL_S = 3.0

LONGEST_FIRST = ("deploy", "integration", "benchmarks", "services")
"""Folders whose files take long begin before the others, so that no process is left alone with one at the end."""


def is_news(record: logging.LogRecord) -> bool:
    """Whether it is not asyncio's word of a callback that took long: on a busy machine any does, but not this long."""
    match record.args:
        case (_, float() as seconds) if str(record.msg).startswith("Executing"):
            return seconds >= STALL_S
    return True


logging.getLogger("asyncio").addFilter(is_news)

# A test's monitor keeps no history unless the test says where.
os.environ.setdefault("FLEETSIGHT_HISTORY", "none")

# Tests run side by side. Threads of one computation that wait for each other spin while another test has their core.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# Zenoh has two receiving threads a process. What waits for a link holds one, and a test's sessions wait for each other.
os.environ.setdefault("ZENOH_RUNTIME", "(rx: (worker_threads: 8))")


class DebugLoop(asyncio.SelectorEventLoop):
    """An event loop with the checks of asyncio's debug mode: calls from other threads, callbacks that take long.

    Debug mode also keeps the stack of whoever makes a handle, a future or a task: two thirds of a page's work.
    """

    def get_debug(self) -> bool:
        """Tell those who would keep a stack that there is no need; the loop's own checks do not ask."""
        return False


def pytest_asyncio_loop_factories() -> Mapping[str, Callable[[], asyncio.AbstractEventLoop]]:
    """Run all coroutines in loops that check, and keep no stacks."""
    return {"debug": DebugLoop}


@pytest.fixture(scope="session", autouse=True)
def model_folder() -> Iterator[Path]:
    """What is made of models, in `cache`, is made once for all tests and their processes, and is not the user's."""
    with tempfile.TemporaryDirectory(prefix="fleetsight-tests-", ignore_cleanup_errors=True) as folder:
        os.environ["FLEETSIGHT_CACHE"] = str(Path(folder) / "cache")
        yield Path(folder)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Bring the folders that take longest to the front; files and tests keep their order."""
    items.sort(key=lambda item: rank(item.path))


def pytest_collection_finish() -> None:
    """Keep the garbage collector from looking at 11,000 tests in each of its rounds: they stay until the end."""
    gc.freeze()


def rank(path: Path) -> int:
    """Return the place of a test file's folder among LONGEST_FIRST, which come before all others."""
    folder = path.relative_to(Path(__file__).parent).parts[0]
    return LONGEST_FIRST.index(folder) if folder in LONGEST_FIRST else len(LONGEST_FIRST)


@pytest.hookimpl(wrapper=True)
def pytest_report_to_serializable() -> Generator[None, Any, Any]:
    """Escape lone surrogates in reports: captured logs have them, and no process can send them to another one."""
    return escaped((yield))


def escaped(data: Any) -> Any:
    """Return plain data with escapes in place of what UTF-8 cannot hold."""
    match data:
        case str():
            return data.encode(errors="backslashreplace").decode()
        case dict():
            return {escaped(key): escaped(value) for key, value in data.items()}
        case list() | tuple():
            return type(data)(map(escaped, data))
        case _:
            return data
