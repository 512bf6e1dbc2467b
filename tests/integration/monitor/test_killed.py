"""How much of what a real monitor took in is lost when it is killed."""

import asyncio
from pathlib import Path

from services.monitor.history.writer import FLUSH_S
from tests.integration.fleet import PATIENCE_S, fleet_rig
from tests.integration.monitor.test_history import PALLETS, QUICK, rows
from tests.integration.monitor.watching import always_seeing, told

HEARTBEAT = "SELECT at_ns FROM heartbeat"


async def test_everything_up_to_the_last_heartbeat_of_a_killed_monitor_is_kept(tmp_path: Path) -> None:
    """Heartbeats are so near to each other that a kill costs a second at most."""
    assert 2 * FLUSH_S <= 1
    file = tmp_path / "history.db"
    async with fleet_rig() as rig, always_seeing(rig, "box") as front:
        where = ("--mode", "client", "--no-web", "--history", f"sqlite:///{file}")
        child = await rig.start("monitor", *where, *QUICK)
        await told(rig, lambda answer: answer.sightings)
        front.names = ("box", "pallet")
        answer = await told(rig, lambda answer: len(answer.sightings) == 2)
        (pallet,) = [each for each in answer.sightings if each.name == "pallet"]
        async with asyncio.timeout(PATIENCE_S):
            while not (beats := rows(file, HEARTBEAT)) or beats[0][0] < pallet.last_ns:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.01)
        child.process.kill()
        await child.process.wait()
    ((since_ns, _),) = rows(file, PALLETS)
    assert since_ns == pallet.first_ns
    assert rows(file, "PRAGMA integrity_check") == [("ok",)]
