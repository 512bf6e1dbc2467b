"""What a real monitor that was cut off, or came late, makes of class lists published meanwhile."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from schemas.detections import KEPT_LISTS
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig
from tests.integration.severed import severable
from tests.integration.test_monitor_history import PALLETS, QUICK, rows
from tests.integration.watching import camera, inventory, taken

CUT_S = 2.5


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def test_no_list_published_while_the_monitor_was_cut_off_is_lost(rig: FleetRig, tmp_path: Path) -> None:
    file = tmp_path / "history.db"
    async with severable(int(rig.endpoint.rpartition(":")[2])) as link, camera(rig) as front:
        await rig.at(link.port).start(
            "monitor", "--mode", "client", "--no-web", "--history", f"sqlite:///{file}", *QUICK
        )
        await inventory(rig)
        await front.watch(0.5)
        link.sever()
        during = front.sent
        await front.watch(CUT_S, "pallet")
        missed = front.sent - during
        link.mend()
        await front.watch(0.2)
        answer = await taken(rig, front.sent)
        assert (answer.class_lists, answer.left_out) == (front.sent, {})
        async with asyncio.timeout(PATIENCE_S):
            while len(rows(file, PALLETS)) < -(-missed // 5):  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.1)


async def test_a_monitor_that_comes_late_or_again_takes_in_what_publishers_kept(rig: FleetRig) -> None:
    where = ("--mode", "client", "--no-web", "--history", "none", *QUICK)
    async with camera(rig) as front:
        await front.watch(0.3, "pallet")
        first = await rig.start("monitor", *where)
        assert [each.name for each in (await taken(rig, front.sent)).sightings] == ["box", "pallet"]
        first.process.kill()
        await first.process.wait()
        for _ in range(KEPT_LISTS + 5):
            front.put("forklift")
            await asyncio.sleep(0.005)
        await rig.start("monitor", *where)
        answer = await taken(rig, KEPT_LISTS)
        assert (answer.class_lists, [each.name for each in answer.sightings]) == (KEPT_LISTS, ["forklift"])
