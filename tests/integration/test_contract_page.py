"""The programs on the contract's page do what it says, without a line of ours."""

import ast
import asyncio
import re
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from bus import Bus, BusSettings, QoS, open_bus
from schemas import codec
from schemas.detections import ClassCount, ClassList
from schemas.keys import CameraKey, Stream
from services.monitor.fleet import Fleet
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import TrustLimits
from services.monitor.requests.inventory_queries import answer_inventory
from tests.contract.conftest import free_endpoint
from tests.schemas.frames import header
from tests.waiting import PATIENCE_S, until

PAGE: Final = Path(__file__).parents[2] / "docs" / "contract.md"
CENTRAL: Final = "tcp/central:7447"
CLASSES: Final = CameraKey("r1", "front").stream(Stream.CLASSES)
SEEN: Final = ClassList(header=header(), classes=[ClassCount("box", 2, 0.9)], model="m", worker="w")
LISTS, INVENTORY = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@asynccontextmanager
async def running(program: str, endpoint: str) -> AsyncIterator[asyncio.StreamReader]:
    """Run a program of the page in a process of its own until leaving; yields what it prints."""
    assert program.count(CENTRAL) == 1
    code = program.replace(CENTRAL, endpoint)
    process = await asyncio.create_subprocess_exec(sys.executable, "-uc", code, stdout=asyncio.subprocess.PIPE)
    try:
        assert process.stdout is not None
        async with asyncio.timeout(PATIENCE_S):
            yield process.stdout
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


def central(endpoint: str) -> BusSettings:
    return BusSettings(mode="router", listen=[endpoint])


async def say(bus: Bus, *messages: tuple[bytes, str]) -> None:
    """Publish payloads and their encodings as class lists, once somebody wants them."""
    for payload, encoding in messages:
        async with bus.publisher(CLASSES, QoS.RESULT, encoding=encoding) as publisher:
            await until(lambda publisher=publisher: publisher.wanted)  # type: ignore[misc]
            publisher.put(payload)


def test_they_need_nothing_of_ours() -> None:
    for program in (LISTS, INVENTORY):
        imports = [node for node in ast.walk(ast.parse(program)) if isinstance(node, ast.Import | ast.ImportFrom)]
        assert {name.name for node in imports for name in node.names} == {"json", "msgspec", "zenoh"}


async def test_a_program_hears_class_lists_and_leaves_out_what_it_does_not_know() -> None:
    endpoint = free_endpoint()
    of_another = codec.encode(ClassList(header=header(robot="r2"), classes=[], model="m", worker="w"))
    encoding = codec.encoding(ClassList)
    async with open_bus(central(endpoint)) as bus, running(LISTS, endpoint) as printed:
        later = encoding.replace(".v1", ".v2")
        await say(bus, (b"\xc1", later), (of_another, encoding), (codec.encode(SEEN), encoding))
        assert await printed.readline() == b"r1 front {'box': 2}\n"


async def test_a_program_asks_for_the_inventory() -> None:
    endpoint = free_endpoint()
    fleet = Fleet("clock", TrustLimits(Debounce(1, 0, 1, 0)))
    fleet.see(SEEN, 1.0, 1_000_000_000)
    async with (
        open_bus(central(endpoint)) as bus,
        answer_inventory(bus, fleet, tuple),
        running(INVENTORY, endpoint) as printed,
    ):
        assert await printed.read() == b"r1 front box 2 None\n"
