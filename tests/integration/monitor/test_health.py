"""What a real monitor says of itself while the router that it is connected to cannot be reached."""

import asyncio
from pathlib import Path

import httpx

from tests.integration.fleet import PATIENCE_S, fleet_rig
from tests.integration.monitor.test_web import said
from tests.integration.network.severed import severable


async def health(monitor: httpx.AsyncClient, status: int) -> str:
    """Wait until the monitor answers so; return what it says of itself."""
    async with asyncio.timeout(PATIENCE_S):
        while (answer := await monitor.get("/healthz")).status_code != status:  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.05)
    return str(answer.json()["status"])


async def test_health_fails_while_the_mesh_is_dead_and_is_good_again_after(tmp_path: Path) -> None:
    where = ("--mode", "client", "--web-port", "0", "--history", f"sqlite:///{tmp_path / 'history.db'}")
    async with fleet_rig() as rig, severable(int(rig.endpoint.rpartition(":")[2])) as link:
        child = await rig.at(link.port).start("monitor", *where)
        async with httpx.AsyncClient(base_url=await said(child, r"page: (\S+)"), timeout=PATIENCE_S) as monitor:
            assert await health(monitor, 200) == "ok"
            link.sever()
            assert await health(monitor, 503) == "dead"
            link.mend()
            assert await health(monitor, 200) == "ok"
