"""Alerts and actions on their way to the robots."""

import asyncio
import hashlib
import hmac
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest

from bus.fake import FakeNetwork
from schemas.alerts import Alert, AlertState
from services.monitor.alerting import robot_delivery as module
from services.monitor.alerting.alerting import Alerting
from services.monitor.alerting.robot_delivery import Lanes
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.rules.rule_file import RuleFile
from tests.services.monitor.alerting.hearing import hears
from tests.services.monitor.alerting.test_webhooks import Receiver, receiving
from tests.services.monitor.inventory.seeing import FRONT, seen
from tests.waiting import until


class Receivers:
    """Receivers that take a message when they are told to."""

    def __init__(self) -> None:
        self.began: list[tuple[str, int]] = []
        self.open = {"a": asyncio.Event(), "b": asyncio.Event()}
        self.given_up: list[tuple[str, bool]] = []
        self.lanes: Lanes[str, int] = Lanes(self.deliver, lambda *said: self.given_up.append(said))

    async def deliver(self, receiver: str, message: int) -> None:
        self.began.append((receiver, message))
        await self.open[receiver].wait()


@asynccontextmanager
async def delivering() -> AsyncIterator[Receivers]:
    receivers = Receivers()
    running = asyncio.create_task(receivers.lanes.run())
    try:
        yield receivers
    finally:
        running.cancel()
        await asyncio.wait([running])


async def test_each_receiver_gets_its_messages_in_order_and_waits_for_no_other() -> None:
    async with delivering() as receivers:
        for message in range(3):
            receivers.lanes.put("a", message)
            receivers.lanes.put("b", message)
        receivers.open["b"].set()
        await until(lambda: receivers.began == [("a", 0), ("b", 0), ("b", 1), ("b", 2)])
        receivers.open["a"].set()
        await until(lambda: receivers.began[4:] == [("a", 1), ("a", 2)])
        receivers.lanes.put("a", 3)
        await until(lambda: receivers.began[-1] == ("a", 3))


async def test_so_many_deliver_at_once_and_the_others_come_after(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "AT_ONCE", 1)
    async with delivering() as receivers:
        receivers.lanes.put("a", 1)
        receivers.lanes.put("b", 1)
        await until(lambda: receivers.began == [("a", 1)])
        receivers.open["a"].set()
        await until(lambda: receivers.began == [("a", 1), ("b", 1)])


async def test_what_waits_is_bounded_and_the_oldest_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_WAITING", 2)
    receivers = Receivers()
    for message in range(4):
        receivers.lanes.put("a", message)
    assert receivers.given_up == [("a", True), ("a", False)]
    receivers.open["a"].set()
    running = asyncio.create_task(receivers.lanes.run())
    await until(lambda: receivers.began == [("a", 2), ("a", 3)])
    running.cancel()
    await asyncio.wait([running])


class Site:
    """A monitor's rules at work. kept: what went to the store."""

    def __init__(self, rules: RuleFile) -> None:
        self.inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0)))
        self.alerting = Alerting(rules, self.inventory, hears(), settle_s=0)
        self.kept: list[Alert] = []
        self._seq = 0

    def see(self, model: str = "m", **counts: int) -> None:
        """Take two class lists: one alone does not make a camera available."""
        for _ in range(2):
            self._seq += 1
            changes = self.inventory.see(seen(self._seq, counts, model=model), time.time_ns())
            self.alerting.take(changes or ())


@asynccontextmanager
async def site(rules: str, folder: Path) -> AsyncIterator[Site]:
    path = folder / "rules.yaml"
    path.write_text(rules, encoding="utf-8")
    file = RuleFile(path)
    await file.load()
    made = Site(file)
    async with FakeNetwork().open_bus() as bus:
        made.inventory.robot_presence("r1", alive=True)
        made.inventory.camera_presence(FRONT, alive=True)
        made.alerting.lead(())
        running = asyncio.create_task(made.alerting.run(bus, keep=made.kept.append, leads=lambda: True))
        try:
            yield made
        finally:
            running.cancel()
            await asyncio.wait([running])


def posted(receiver: Receiver) -> list[Alert]:
    return [msgspec.json.decode(body, type=Alert) for _, body in receiver.got]


async def test_whatever_becomes_of_an_alert_is_posted_in_order_and_what_nobody_acknowledges_escalates(
    tmp_path: Path,
) -> None:
    async with receiving(503, 200) as (receiver, webhook):
        rules = (
            f"webhooks: {{ops: {{url: '{webhook.url}', secret: a long secret}}}}\n"
            "rules: [{name: boxes, when: over, class: box, count: 0, severity: critical,"
            " escalate_after_s: 0.3, webhooks: [ops]}]"
        )
        async with site(rules, tmp_path) as made:
            made.see(box=1)
            await until(lambda: len(made.kept) == 2)
            made.see()
            await until(lambda: len(receiver.got) == 4)
            assert posted(receiver)[1:] == made.kept
    assert [each.state for each in made.kept] == [AlertState.RAISED, AlertState.ESCALATED, AlertState.RESOLVED]
    assert posted(receiver)[0] == posted(receiver)[1], "the first one was tried again"
    assert {(each.rule, each.severity, each.robot, each.name) for each in made.kept} == {
        ("boxes", "critical", "r1", "box")
    }


async def test_who_is_told_of_escalations_hears_of_an_alert_from_then_on_to_its_end(tmp_path: Path) -> None:
    async with receiving(200) as (ops, to_ops), receiving(503, 200) as (boss, to_boss):
        rules = (
            f"webhooks: {{ops: {{url: '{to_ops.url}', secret: a long secret}},"
            f" boss: {{url: '{to_boss.url}', secret: a longer secret}}}}\n"
            "rules:\n"
            "  - {name: boxes, when: over, class: box, count: 0, escalate_after_s: 0.3, webhooks: [ops],"
            " escalate_webhooks: [ops, boss]}\n"
            "  - {name: pallets, when: over, class: pallet, count: 0, webhooks: [ops], escalate_webhooks: [boss]}\n"
        )
        async with site(rules, tmp_path) as made:
            made.see(box=1, pallet=1)
            await until(lambda: len(made.kept) == 3)
            assert made.kept[2].state is AlertState.ESCALATED
            made.alerting.acknowledge(made.kept[2].id)
            await until(lambda: len(made.kept) == 4)
            made.see()
            await until(lambda: len(ops.got) == 6 and len(boss.got) == 4)
    assert posted(ops) == made.kept
    assert posted(boss)[0] == posted(boss)[1], "the first one was tried again"
    escalated = made.kept[2].id
    assert posted(boss)[1:] == [each for each in made.kept[2:] if each.id == escalated]
    assert [each.state for each in posted(boss)[1:]] == ["escalated", "acknowledged", "resolved"]
    headers, body = boss.got[0]
    stamped = headers["x-fleetsight-timestamp"].encode() + b"." + body
    expected = hmac.new(b"a longer secret", stamped, hashlib.sha256).hexdigest()
    assert headers["x-fleetsight-signature"] == f"sha256={expected}"


async def test_two_models_that_count_a_camera_differently_are_alerted_until_they_agree(tmp_path: Path) -> None:
    async with site("rules: [{name: odd, when: disagree, for_s: 0.2}]", tmp_path) as made:
        made.see("one", box=1, pallet=1)
        made.see("other", box=3)
        await until(lambda: bool(made.kept))
        made.see("one", box=1)
        made.see("other", box=1)
        await until(lambda: len(made.kept) == 2)
    raised, resolved = made.kept
    assert (raised.name, raised.text) == ("box", "two models count 1 and 3 box in view of r1/front")
    assert (resolved.id, resolved.state) == (raised.id, AlertState.RESOLVED)
