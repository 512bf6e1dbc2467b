"""The programs on the client's page, and the README's, do what it says."""

import ast
import asyncio
import os
import re
import sys
from pathlib import Path
from typing import Final

import pytest

import fleetsight
from tests.fleetsight.stand_in import stand_in
from tests.waiting import PATIENCE_S, next_of

ROOT: Final = Path(__file__).parents[2]
CENTRAL: Final = "tcp/central:7447"
BLOCK: Final = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
LISTS, FOUND, OWN = BLOCK.findall((ROOT / "docs/client.md").read_text(encoding="utf-8"))
(FIRST,) = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))


async def start(program: str, endpoint: str) -> asyncio.subprocess.Process:
    assert program.count(CENTRAL) == 1
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-uc", program.replace(CENTRAL, endpoint)),
        stdout=asyncio.subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


async def end(process: asyncio.subprocess.Process) -> None:
    process.kill()
    await process.communicate()


@pytest.mark.parametrize(
    ("program", "said"),
    [
        (LISTS, "r1 front [ClassCount(name='box', count=2, score=0.75)]"),
        (FIRST, "r1 front [ClassCount(name='box', count=2, score=0.75)]"),
        (FOUND, "r1 box 0.75 Box(x1=1.0, y1=1.0, x2=3.0, y2=4.0)"),
    ],
    ids=["page", "readme", "queue"],
)
async def test_what_listens_prints(program: str, said: str) -> None:
    async with stand_in() as there:
        process = await start(program, there.endpoint)
        assert process.stdout is not None
        async with asyncio.timeout(PATIENCE_S):
            assert (await process.stdout.readline()).decode() == f"{said}\n"
        await end(process)


async def test_what_serves_a_model_is_a_detector() -> None:
    async with stand_in(worker=False) as there, fleetsight.connect(there.endpoint) as fleet:
        process = await start(OWN, there.endpoint)
        found = await next_of(aiter(fleet.detections()))
        assert [each.name for each in found.objects] == ["picture"]
        await end(process)


def test_the_first_program_is_five_lines_and_what_runs_them() -> None:
    assert len(ast.parse(LISTS).body) == 3
    assert len([line for line in LISTS.splitlines() if line]) == 6
    assert LISTS == FIRST


def test_the_page_names_every_error() -> None:
    page = (ROOT / "docs/client.md").read_text(encoding="utf-8")
    errors = [name for name in fleetsight.api.__all__ if name.endswith("Error")]
    assert [name for name in errors if f"`{name}`" not in page and f".{name}`" not in page] == []
