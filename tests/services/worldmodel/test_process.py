"""The world model's worker keeps its sites in files."""

import asyncio
import time
from contextlib import suppress
from pathlib import Path

import pytest

from services.worldmodel import process


async def test_a_state_that_is_being_written_is_whole_before_the_last_one_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[str] = []

    def write(_: Path, state: bytes) -> None:
        steps.append(f"begin {state.decode()}")
        time.sleep(0.2)
        steps.append(f"end {state.decode()}")

    monkeypatch.setattr(process, "_write", write)
    states = asyncio.Queue[bytes](1)
    states.put_nowait(b"1")
    writing = asyncio.create_task(process._write_all(tmp_path / "main.world", states))
    async with asyncio.timeout(5):
        while not steps:  # noqa: ASYNC110 - a thread writes
            await asyncio.sleep(0.01)
    writing.cancel()
    with suppress(asyncio.CancelledError):
        await writing
    assert steps == ["begin 1", "end 1"]
