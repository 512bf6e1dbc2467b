"""A webhook that is down while the monitor is restarted."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from bus.fake import FakeNetwork
from services.monitor.alerting.alerting import Alerting
from services.monitor.alerting.webhooks import Outcome
from services.monitor.history.settings import HistorySettings
from services.monitor.history.writer import HistoryWriter
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.inventory.sighting import Change
from services.monitor.rules.rule_file import RuleFile
from tests.services.monitor.alerting.hearing import hears
from tests.services.monitor.alerting.test_webhooks import receiving, told
from tests.services.monitor.history.test_store import opened
from tests.services.monitor.inventory.seeing import FRONT, seen
from tests.waiting import until


@asynccontextmanager
async def monitor(rules: Path, url: str) -> AsyncIterator[tuple[Inventory, Alerting]]:
    file = RuleFile(rules)
    await file.load()
    inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0)))
    alerting = Alerting(file, inventory, hears(), settle_s=0)
    history = HistoryWriter(HistorySettings(history=url), inventory, alerting.lead, owing=alerting)
    await history.restore()
    async with FakeNetwork().open_bus() as bus:
        running = [
            asyncio.create_task(history.run()),
            asyncio.create_task(alerting.run(bus, keep=history.alert, leads=lambda: history.status.leads)),
        ]
        await until(lambda: history.status.leads)
        inventory.robot_presence("r1", alive=True)
        inventory.camera_presence(FRONT, alive=True)
        try:
            yield inventory, alerting
        finally:
            for task in running:
                task.cancel()
                await asyncio.wait([task])


async def test_an_alert_that_a_webhook_did_not_take_is_posted_by_the_next_monitor(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    async with receiving(503) as (down, webhook):
        rules = tmp_path / "rules.yaml"
        rules.write_text(
            f"webhooks: {{ops: {{url: '{webhook.url}', secret: a long secret}}}}\n"
            "rules: [{name: boxes, when: over, class: box, count: 0, webhooks: [ops]}]",
            encoding="utf-8",
        )
        async with monitor(rules, url) as (inventory, alerting):
            see(inventory, alerting)
            await until(lambda: down.got)
            (owed,) = alerting.owed()
    async with opened(url) as store:
        assert (await store.load(0)).owed == [owed]
    async with receiving(200) as (receiver, webhook):
        rules.write_text(rules.read_text(encoding="utf-8").replace(str(down_url(rules)), str(webhook.url)))
        async with monitor(rules, url) as (_, alerting):
            await until(lambda: alerting.posts().get(("ops", Outcome.DELIVERED)))
        assert told(receiver)[0] == [(owed[1].id, "raised")]
    async with opened(url) as store:
        assert (await store.load(0)).owed == []


def see(inventory: Inventory, alerting: Alerting) -> None:
    """Have boxes come into view."""
    for seq in (1, 2):
        changes: list[Change] = inventory.see(seen(seq, {"box": 1}), time.time_ns()) or []
        alerting.take(changes)


def down_url(rules: Path) -> str:
    """Return the address that a rule file posts to."""
    return rules.read_text(encoding="utf-8").split("'")[1]
