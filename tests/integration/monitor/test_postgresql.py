"""Real monitor processes on a real PostgreSQL: which one raises the alerts, and what they do without the database."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from bus import Subscription
from schemas.alerts import Alert, AlertState
from services.monitor.history.intervals import Interval
from services.monitor.history.tables import intervals
from services.toolbox.demo.children import Child
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig, receive
from tests.integration.monitor.test_history import QUICK
from tests.integration.monitor.watching import always_seeing, told
from tests.services.monitor.history.support.postgresql import PostgreSQL, running_postgresql
from tests.services.monitor.history.test_store import opened

RULES = """
rules:
  - {name: boxes, when: over, class: box, count: 0}
  - {name: pallets, when: over, class: pallet, count: 0}
"""


@pytest.fixture(scope="module")
def postgresql() -> Iterator[PostgreSQL]:
    with running_postgresql() as server:
        yield server


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    file = tmp_path / "rules.yaml"
    file.write_text(RULES, encoding="utf-8")
    return file


async def monitor(rig: FleetRig, url: str, rules: Path) -> Child:
    """Start a monitor; it sees the camera by then."""
    started = await rig.start(
        "monitor", "--mode", "client", "--no-web", "--history", url, "--rules", str(rules), *QUICK
    )
    async with asyncio.timeout(PATIENCE_S):
        while not any("1 box" in line for line in started.output):  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.05)
    return started


async def news(alerts: Subscription, rule: str, state: AlertState) -> Alert:
    """Return the next alert, which is to be such a one."""
    alert = await receive(alerts, Alert)
    assert (alert.rule, alert.state) == (rule, state)
    return alert


async def kept(url: str, alert: Alert) -> None:
    """Wait until the database holds an alert; one that is not there yet, whoever takes over raises again."""
    async with opened(url) as store, asyncio.timeout(PATIENCE_S):
        while alert.id not in {each.id for each in (await store.load(0)).alerts}:  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.05)


@pytest.mark.timeout(180)
async def test_when_the_monitor_that_raises_alerts_is_killed_another_goes_on_with_them(
    rig: FleetRig, postgresql: PostgreSQL, rules: Path
) -> None:
    url = postgresql.create("two_monitors")
    async with rig.subscribed("fleet/r1/alerts") as alerts, always_seeing(rig, "box") as front:
        first = await monitor(rig, url, rules)
        boxes = await news(alerts, "boxes", AlertState.RAISED)
        await monitor(rig, url, rules)
        front.names = ("box", "pallet")
        await kept(url, await news(alerts, "pallets", AlertState.RAISED))
        first.process.kill()
        await first.process.wait()
        front.names = ("pallet",)
        assert (await news(alerts, "boxes", AlertState.RESOLVED)).id == boxes.id
        front.names = ("pallet", "box")
        assert (await news(alerts, "boxes", AlertState.RAISED)).id != boxes.id


@pytest.mark.timeout(180)
async def test_monitoring_goes_on_without_the_database_and_what_was_seen_meanwhile_is_kept(
    rig: FleetRig, postgresql: PostgreSQL, rules: Path
) -> None:
    url = postgresql.create("gone_and_back")
    async with always_seeing(rig, "box") as front:
        await monitor(rig, url, rules)
        assert not (await told(rig, lambda answer: not answer.problems)).left_out
        await asyncio.to_thread(postgresql.stop)
        gone = await told(rig, lambda answer: answer.problems)
        assert gone.problems[0].startswith("history is not being kept: ")
        front.names = ("box", "pallet")
        await told(rig, lambda answer: "pallet" in [each.name for each in answer.sightings])
        front.names = ("box",)
        await told(rig, lambda answer: [each.count for each in answer.sightings if each.name == "pallet"] == [0])
        await asyncio.to_thread(postgresql.start)
        await told(rig, lambda answer: not answer.problems)
        async with opened(url) as store, asyncio.timeout(PATIENCE_S):
            while not await store.select(Interval, intervals.c.name == "pallet"):  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.1)


@pytest.mark.timeout(180)
async def test_everything_up_to_the_last_heartbeat_of_a_killed_monitor_is_kept(
    rig: FleetRig, postgresql: PostgreSQL, rules: Path
) -> None:
    url = postgresql.create("killed")
    async with opened(url) as store, always_seeing(rig, "box") as front:
        child = await monitor(rig, url, rules)
        front.names = ("box", "pallet")
        answer = await told(rig, lambda answer: len(answer.sightings) == 2)
        (pallet,) = [each for each in answer.sightings if each.name == "pallet"]
        async with asyncio.timeout(PATIENCE_S):
            while await store.heartbeat_ns() < pallet.last_ns:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.01)
        child.process.kill()
        await child.process.wait()
        (there,) = await store.select(Interval, intervals.c.name == "pallet")
    assert there.since_ns == pallet.first_ns
