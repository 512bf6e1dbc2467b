import asyncio
import os

import pytest

from services.toolbox.demo.children import ChildFailedError, child


async def test_a_process_that_ends_by_itself_is_a_failure_with_its_last_words() -> None:
    said: list[str] = []
    with pytest.raises(ChildFailedError, match="broken ended with exit code 2: fleetsight gateway: unrecognized"):
        async with child("broken", ["gateway", "--nonsense"], said.append) as started:
            await started.ended()
    assert said == ["broken: fleetsight gateway: unrecognized arguments: --nonsense"]


async def test_output_is_kept_whole() -> None:
    async with child("version", ["--version"], print) as started:
        with pytest.raises(ChildFailedError, match="exit code 0: without output"):
            await started.ended()
        assert len(started.output) == 1
        assert started.output[0].startswith("fleetsight ")


async def test_leaving_ends_the_process() -> None:
    gateway = ["gateway", "--robot", "r1", "--ros-master", "http://127.0.0.1:1", "--connect", "tcp/127.0.0.1:1"]
    async with child("gateway", gateway, print) as started:
        await asyncio.sleep(0.3)
        pid = started.process.pid
    assert started.process.returncode is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
