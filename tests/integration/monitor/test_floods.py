"""A real monitor under floods of messages: its memory stays bounded, it answers, and robots still find room."""

import asyncio
import itertools
from collections.abc import AsyncIterator

import pytest

from benchmarks.security.floods import ASK_S, Victim, victim
from bus import QoS
from schemas import codec, keys
from schemas.detections import ClassList
from schemas.keys import Stream
from tests.integration.fleet import PATIENCE_S
from tests.services.monitor.inventory.seeing import FRONT, seen

MESSAGES = {"names": 60_000, "robot": 60_000, "lists": 600, "statuses": 300, "workers": 600}
"""How many are sent: of most kinds, several times the memory that they may take."""
MOST_MB = 200


@pytest.fixture
async def attacked() -> AsyncIterator[Victim]:
    async with victim() as made:
        yield made


@pytest.mark.parametrize("kind", MESSAGES)
async def test_a_flood_takes_no_more_memory_than_there_is_for_it_and_nobodys_place(attacked: Victim, kind: str) -> None:
    found = await attacked.flood(kind, 0.0, MESSAGES[kind])
    assert found.rss_growth_mb <= MOST_MB
    assert found.answer_s < ASK_S
    if kind == "robot":
        assert found.others_s < ASK_S
    if kind == "names":
        async with asyncio.timeout(PATIENCE_S):
            while not any("make room" in problem for problem in (await attacked.answer()).problems):  # noqa: ASYNC110
                await asyncio.sleep(0.1)
    bus = attacked.bus
    lists = bus.publisher(FRONT.stream(Stream.CLASSES), QoS.RESULT, encoding=codec.encoding(ClassList))
    async with (
        bus.announce(keys.robot_alive("r1")),
        bus.announce(FRONT.alive(Stream.COLOR)),
        lists as publisher,
        asyncio.timeout(PATIENCE_S),
    ):
        for seq in itertools.count():
            publisher.put(codec.encode(seen(seq, {"box": 1})))
            if [each for each in (await attacked.answer()).sightings if each.available]:
                break
            await asyncio.sleep(0.1)
