"""The examples as users run them: processes of their own, against a small fleet on the real bus."""

import asyncio
import csv
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pytest
import simplejpeg

import fleetsight
from bus import BusSettings, open_bus
from schemas import keys
from schemas.keys import Stream
from schemas.worker_keys import WorkerAlive
from services.detector.requests import answering
from tests.contract.conftest import free_endpoint
from tests.fleetsight.stand_in import FRONT, stand_in
from tests.services.detector.support.fakes import FakeModel
from tests.waiting import PATIENCE_S, next_of, until

ROOT: Final = Path(__file__).parents[2]
EXAMPLES: Final = ROOT / "examples"
MAX_LINES: Final = 60


@dataclass(slots=True)
class Running:
    """A running example."""

    process: asyncio.subprocess.Process

    async def line(self) -> str:
        """Return the next line it prints."""
        assert self.process.stdout is not None
        async with asyncio.timeout(PATIENCE_S):
            return (await self.process.stdout.readline()).decode().rstrip("\n")

    async def ended(self) -> str:
        """Wait for its end; return what it printed meanwhile."""
        async with asyncio.timeout(PATIENCE_S):
            said, _ = await self.process.communicate()
        return said.decode()


@asynccontextmanager
async def running(name: str, endpoint: str, *arguments: str | Path) -> AsyncIterator[Running]:
    """Run an example until leaving, which interrupts it as Ctrl-C does: that is no failure."""
    process = await asyncio.create_subprocess_exec(
        *("env", "--default-signal=INT"),  # which a shell's background jobs ignore, and so would the example
        *(sys.executable, EXAMPLES / f"{name}.py", *arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env={**os.environ, "FLEETSIGHT_CONNECT": endpoint, "PYTHONPATH": str(ROOT)},
    )
    example = Running(process)
    try:
        yield example
        if process.returncode is None:
            process.send_signal(signal.SIGINT)
            said = await example.ended()
            assert await process.wait() == 0, said
            assert "Traceback" not in said
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def test_class_lists_are_printed() -> None:
    async with stand_in() as there, running("class_lists", there.endpoint, "r*") as example:
        assert await example.line() == "r1/front {'box': 2}"


async def test_distances_are_written_as_csv(tmp_path: Path) -> None:
    table = tmp_path / "distances.csv"

    def rows() -> list[list[str]]:
        return list(csv.reader(table.read_text().splitlines())) if table.exists() else []

    async with stand_in() as there, running("distances_to_csv", there.endpoint, table):
        await until(lambda: len(rows()) == 3)
    titles, first, second = rows()
    assert dict(zip(titles, first, strict=True)) == {
        "stamp_s": "1700000000.0",
        "robot": "r1",
        "camera": "front",
        "object": "box",
        "track": "1",
        "distance_m": "2.5",
        "x_map_m": "1.0",
        "y_map_m": "2.0",
        "unknown": "",
    }
    assert second[5:] == ["", "", "", "no reading"]


async def test_alerts_and_robots_are_printed() -> None:
    async with stand_in() as there, running("alerts", there.endpoint) as example:
        first = {await example.line(), await example.line()}
        assert first == {"r1: warning, raised: a box stands in the way", "r1: here"}
        async with there.bus.announce(keys.robot_alive("r2")):
            assert await example.line() == "r2: here"
        assert await example.line() == "r2: gone"


async def test_an_image_is_looked_at_by_a_worker(tmp_path: Path) -> None:
    photo, endpoint = tmp_path / "photo.jpg", free_endpoint()
    photo.write_bytes(simplejpeg.encode_jpeg(np.full((40, 60, 3), 99, np.uint8), colorspace="RGB"))
    async with (
        open_bus(BusSettings(mode="router", listen=[endpoint])) as bus,
        answering(bus, FakeModel(), "w1"),
        bus.announce(str(WorkerAlive("detector", "w1"))),
        running("one_image", endpoint, photo) as example,
    ):
        assert await example.ended() == "box 0.75 at 0,0 to 60,40 pixels\n1 objects by fake of w1\n"
    assert example.process.returncode == 0


async def test_why_an_image_is_not_looked_at_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "text.jpg").write_text("no image")
    endpoint = free_endpoint()
    async with AsyncExitStack() as stack:
        bus = await stack.enter_async_context(open_bus(BusSettings(mode="router", listen=[endpoint])))
        await stack.enter_async_context(answering(bus, FakeModel(), "w1"))
        await stack.enter_async_context(bus.announce(str(WorkerAlive("detector", "w1"))))
        example = await stack.enter_async_context(running("one_image", endpoint, tmp_path / "text.jpg"))
        said = await example.ended()
    assert said.startswith("an image for a detector worker: worker w1: not an image")
    assert (said.count("\n"), example.process.returncode) == (1, 1)


async def test_a_service_of_ones_own_takes_images_while_somebody_wants_results() -> None:
    async with (
        stand_in(worker=False) as there,
        running("own_service", there.endpoint),
        fleetsight.connect(there.endpoint) as fleet,
    ):
        assert (await next_of(aiter(fleet.workers("detector")))).here
        assert not there.wanted(Stream.COLOR)
        found = await next_of(aiter(fleet.detections("r1")))
        assert (found.model, found.header.robot, found.header.camera) == ("brightness", FRONT.robot, FRONT.camera)
        assert all(each.name == "bright" and each.score > 0.7 for each in found.objects)
        await until(lambda: not there.wanted(Stream.COLOR))


@pytest.fixture(params=sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def example(request: pytest.FixtureRequest) -> Path:
    path: Path = request.param
    return path


def test_examples_are_short_and_use_nothing_but_the_front_door(example: Path) -> None:
    lines = example.read_text(encoding="utf-8").splitlines()
    assert len(lines) < MAX_LINES
    assert not [line for line in lines if line.startswith(("from bus", "from schemas", "from services", "import bus"))]
