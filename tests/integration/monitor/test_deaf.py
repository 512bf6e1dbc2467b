"""What the rules of a real monitor make of a fleet that it cannot hear for a while."""

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path

import httpx

from schemas import keys
from tests.integration.fleet import PATIENCE_S, fleet_rig
from tests.integration.monitor.test_health import health
from tests.integration.monitor.test_history import rows
from tests.integration.monitor.test_web import said
from tests.integration.monitor.watching import always_seeing, told
from tests.integration.network.severed import severable

RULES = """
rules:
  - {name: robot lost, when: silent}
  - {name: robot lost for long, when: silent, for_s: 2}
  - {name: camera lost, when: silent, cameras: ["*"]}
"""
ALERTS = "SELECT rule, robot, state FROM alerts ORDER BY robot, rule"


async def test_robots_that_a_cut_off_monitor_cannot_hear_are_not_silent_and_one_that_went_meanwhile_is(
    tmp_path: Path,
) -> None:
    file, rules = tmp_path / "history.db", tmp_path / "rules.yaml"
    rules.write_text(RULES, encoding="utf-8")
    where = ("--mode", "client", "--web-port", "0", "--history", f"sqlite:///{file}", "--rules", str(rules))
    async with (
        fleet_rig() as rig,
        severable(int(rig.endpoint.rpartition(":")[2])) as link,
        always_seeing(rig, "box"),
        AsyncExitStack() as r2,
    ):
        await r2.enter_async_context(rig.bus.announce(keys.robot_alive("r2")))
        child = await rig.at(link.port).start("monitor", *where)
        async with httpx.AsyncClient(base_url=await said(child, r"page: (\S+)"), timeout=PATIENCE_S) as monitor:
            await told(rig, lambda answer: answer.class_lists)
            async with rig.bus.announce(keys.robot_alive("r0")):
                await said(child, r"r1/front: (online)")
                async with asyncio.timeout(PATIENCE_S):
                    while rows(file, "SELECT count(*) FROM presence WHERE robot = 'r0'") != [(1,)]:  # noqa: ASYNC110 - nobody tells
                        await asyncio.sleep(0.1)
            async with asyncio.timeout(PATIENCE_S):
                while len(rows(file, ALERTS)) < 2:  # noqa: ASYNC110 - nobody tells
                    await asyncio.sleep(0.1)
            link.sever()
            assert await health(monitor, 503) == "dead"
            await r2.aclose()
            link.mend()
            assert await health(monitor, 200) == "ok"
            async with asyncio.timeout(PATIENCE_S):
                while len(rows(file, ALERTS)) < 4:  # noqa: ASYNC110 - nobody tells
                    await asyncio.sleep(0.1)
    assert rows(file, ALERTS) == [
        ("robot lost", "r0", "raised"),
        ("robot lost for long", "r0", "raised"),
        ("robot lost", "r2", "raised"),
        ("robot lost for long", "r2", "raised"),
    ]
