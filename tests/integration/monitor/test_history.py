"""A monitor's history as it is run: a real process over Zenoh, killed while it writes."""

import asyncio
import sqlite3
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from bus import QoS
from schemas import codec, keys
from schemas.detections import ClassList
from schemas.inventory import InventoryAnswer
from schemas.keys import Stream
from services.toolbox.demo.children import Child
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig
from tests.services.monitor.inventory.seeing import FRONT, seen

QUICK = ("--appear-lists", "1", "--vanish-lists", "1", "--vanish-s", "0")


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def monitor(rig: FleetRig, file: Path) -> Child:
    return await rig.start("monitor", "--mode", "client", "--no-web", "--history", f"sqlite:///{file}", *QUICK)


@asynccontextmanager
async def publishing(rig: FleetRig) -> AsyncIterator[None]:
    """Publish class lists: a box all the time, a pallet every other time."""

    async def publish() -> None:
        key, encoding = FRONT.stream(Stream.CLASSES), codec.encoding(ClassList)
        async with rig.bus.publisher(key, QoS.RESULT, encoding=encoding) as publisher:
            seq = 0
            while True:
                seq += 1
                publisher.put(codec.encode(seen(seq, {"box": 1, "pallet": seq % 2})))
                await asyncio.sleep(0.05)

    running = asyncio.create_task(publish())
    try:
        yield
    finally:
        running.cancel()
        await asyncio.wait([running])


def rows(file: Path, query: str) -> list[tuple[Any, ...]]:
    if not file.exists():
        return []
    with closing(sqlite3.connect(file)) as database:
        try:
            return database.execute(query).fetchall()
        except sqlite3.OperationalError:  # no tables yet
            return []


PALLETS = "SELECT since_ns, until_ns FROM intervals WHERE name = 'pallet' ORDER BY since_ns"
BOXES = "SELECT since_ns, until_ns FROM intervals WHERE name = 'box' ORDER BY since_ns"


async def pallets(file: Path, more_than: int) -> list[tuple[Any, ...]]:
    """Wait until so many pallets were kept."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            found = await asyncio.to_thread(rows, file, PALLETS)
            if len(found) > more_than:
                return found
            await asyncio.sleep(0.05)


async def test_a_killed_monitor_begins_again_where_it_was(rig: FleetRig, tmp_path: Path) -> None:
    file = tmp_path / "history.db"
    async with publishing(rig):
        first = await monitor(rig, file)
        before = await pallets(file, 5)
        first.process.kill()
        await first.process.wait()
        await monitor(rig, file)
        after = await pallets(file, len(before) + 5)
        reply = await rig.bus.request(keys.INVENTORY, timeout_s=5)
    assert after[: len(before) - 1] == before[:-1]
    assert rows(file, "PRAGMA integrity_check") == [("ok",)]
    assert all(until <= later for (_, until), (later, _) in pairwise(after))
    ((since_ns, _),) = rows(file, BOXES)
    answer = codec.decode(InventoryAnswer, reply.payload, reply.encoding)
    assert [each.first_ns for each in answer.sightings if each.name == "box"] == [since_ns]
