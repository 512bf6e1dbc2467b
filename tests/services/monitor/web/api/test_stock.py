import pytest

from schemas.keys import CameraKey
from services.monitor import event_loop
from services.monitor.inventory.inventory import Inventory
from services.monitor.web.api.fleet import SightingKey, SightingQuery, some_entries
from tests.services.monitor.inventory.seeing import S, seen


def stocked(robots: int = 3) -> Inventory:
    """Return robots with two cameras each that see two classes; of r0's front camera the pallet went."""
    inventory = Inventory()
    for number in range(robots):
        for camera in ("front", "rear"):
            key = CameraKey(f"r{number}", camera)
            inventory.robot_presence(key.robot, alive=number != 1)
            inventory.camera_presence(key, alive=True)
            for seq in (1, 2):
                inventory.see(seen(seq, {"pallet": 1, "box": 2}, key=key), seq)
    for seq in (3, 4, 5):
        inventory.see(seen(seq, {"box": 2}, key=CameraKey("r0", "front")), seq * S)
    return inventory


async def places(asked: SightingQuery, most: int = 100, *, robots: int = 3) -> list[SightingKey]:
    found = await some_entries(stocked(robots), asked, most, 2)
    return [(each.sighting.key.robot, each.sighting.key.camera, each.sighting.name) for each in found]


async def test_all_of_it_is_what_the_inventory_lists() -> None:
    inventory = stocked()
    assert await some_entries(inventory, SightingQuery(), 100, 2) == list(inventory.entries(2))


async def test_pages_go_on_behind_what_was_the_last_wherever_that_was() -> None:
    every = await places(SightingQuery())
    assert len(every) == 12
    for number, place in enumerate(every):
        assert await places(SightingQuery(after=place), 4) == every[number + 1 : number + 5]
    assert await places(SightingQuery(after=("r0", "front", "crate")), 1) == [("r0", "front", "pallet")]
    assert await places(SightingQuery(after=("r0", "middle", "")), 1) == [("r0", "rear", "box")]
    assert await places(SightingQuery(robot="r1", after=("r0", "front", "box")), 1) == [("r1", "front", "box")]


async def test_only_what_is_asked_for() -> None:
    assert {robot for robot, _, _ in await places(SightingQuery(robot="r1"))} == {"r1"}
    assert {camera for _, camera, _ in await places(SightingQuery(camera="rear"))} == {"rear"}
    assert len(await places(SightingQuery(name="pallet"))) == 6
    assert len(await places(SightingQuery(name="pallet", in_view=True))) == 5
    assert {robot for robot, _, _ in await places(SightingQuery(available=False))} == {"r1"}
    assert {robot for robot, _, _ in await places(SightingQuery(available=True))} == {"r0", "r2"}


async def test_what_takes_many_turns_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_loop, "TURN_S", 0.0)
    assert len(await places(SightingQuery(name="box"), 1_000, robots=20)) == 40
