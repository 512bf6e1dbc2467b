import asyncio
import sys
from pathlib import Path

import pytest

from benchmarks.running.process import BenchmarkError, run


def stand_in(name: str) -> list[str]:
    return [sys.executable, "-m", f"tests.benchmarks.stand_ins.{name}", "--json"]


async def test_what_a_benchmark_prints_is_found_and_what_it_says_is_shown() -> None:
    said: list[str] = []
    found = await run(stand_in("quick"), 60, said.append)
    assert (found["speed"], said) == (3.0, ["nearly there"])


@pytest.mark.parametrize(
    ("name", "reason"),
    [("wrong", r"exit code 1: looking \| cannot go on"), ("garbled", "no JSON object"), ("no", "No")],
)
async def test_a_benchmark_that_fails_says_why(name: str, reason: str) -> None:
    with pytest.raises(BenchmarkError, match=reason):
        await run(stand_in(name), 60, lambda _: None)


async def test_only_the_last_lines_are_kept_of_a_talkative_one() -> None:
    talk = (
        "import sys\nfor i in range(9): print(i, file=sys.stderr)\nprint('x' * 100_000, file=sys.stderr)\nsys.exit(3)"
    )
    with pytest.raises(BenchmarkError, match=r"^exit code 3: 4 \| 5 \| 6 \| 7 \| 8$"):
        await run([sys.executable, "-c", talk], 60, lambda _: None)


async def test_one_that_takes_too_long_is_ended_with_all_it_started() -> None:
    said: list[str] = []
    began = asyncio.Event()

    def say(line: str) -> None:
        said.append(line)
        began.set()

    running = asyncio.create_task(run(stand_in("late"), 600, say))
    await began.wait()
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    while alive(int(said[0].split()[1])):  # noqa: ASYNC110 - another process
        await asyncio.sleep(0.01)


async def test_the_limit_is_said() -> None:
    with pytest.raises(BenchmarkError, match=r"^not done after 0\.01 s$"):
        await run(stand_in("late"), 0.01, lambda _: None)


DEAF = """
import signal, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("deaf", file=sys.stderr)
time.sleep(600)
"""


async def test_one_that_does_not_end_when_asked_is_killed() -> None:
    began = asyncio.Event()
    running = asyncio.create_task(run([sys.executable, "-c", DEAF], 600, lambda _: began.set(), end_s=0.1))
    await began.wait()
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
