import asyncio

from bus.api import Presence
from bus.delivery.reading import PresenceReader

ROBOTS = 20_000


async def test_the_presence_of_a_large_fleet_comes_at_once_and_whole() -> None:
    reader = PresenceReader(asyncio.get_running_loop())
    for number in range(ROBOTS):
        reader.arrive(f"fleet/r{number}/alive", alive=True)
    found = {await anext(reader) for _ in range(ROBOTS)}
    assert found == {Presence(f"fleet/r{number}/alive", alive=True) for number in range(ROBOTS)}
