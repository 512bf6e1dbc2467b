"""`fleetsight rules test`, and rules in a running monitor."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import datetime
from pathlib import Path

import pytest

from bus.fake import FakeNetwork
from schemas.alerts import Alert
from schemas.keys import CameraKey
from services.monitor.alerting.alerting import Alerting
from services.monitor.history.interval_buffer import StoredInterval
from services.monitor.history.settings import HistorySettings
from services.monitor.history.state import HistoryError
from services.monitor.history.store import Store
from services.monitor.history.writer import HistoryWriter
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.liveness import SETTLE_NS
from services.monitor.rules.command import run
from services.monitor.rules.loading import RuleFileError
from services.monitor.rules.rule_file import RuleFile
from services.monitor.settings import RulesSettings
from tests.services.monitor.alerting.hearing import hears
from tests.services.monitor.history.support.stored_intervals import disagreement, there
from tests.services.monitor.inventory.seeing import S, seen
from tests.services.monitor.rules.replaying import HISTORY
from tests.waiting import until

BOTH = "rules: [{name: gone, when: silent}, {name: odd, when: disagree}]"

MORE = """,
  {name: mute, when: silent, cameras: [front], robots: [r1]},
  {name: left, when: disappears, class: box},
  {name: many, when: over, class: box, count: 1}]
"""


async def written(url: str, some: list[StoredInterval], heartbeat_s: int) -> None:
    store = await Store.open(url)
    try:
        await store.write(some, [], heartbeat_s * S)
    finally:
        await store.close()


async def printed(
    tmp_path: Path, rules: str, capsys: pytest.CaptureFixture[str], since: str | None = None
) -> list[str]:
    """Return what the command prints about the history, without times."""
    file = tmp_path / "rules.yaml"
    file.write_text(rules, encoding="utf-8")
    history = f"sqlite:///{tmp_path}/history.db"
    await run(RulesSettings.model_validate({"task": "test", "file": file, "history": history, "since": since}))
    return capsys.readouterr().out.splitlines()


async def test_silence_and_disagreements_are_tried(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there_and_gone = [there(1, 99, "", is_open=True), there(2, 20), there(2, 99, camera="front", is_open=True)]
    await written(f"sqlite:///{tmp_path}/history.db", [*there_and_gone, disagreement(5, 30)], 99)
    odd, gone, agreed, summary = await printed(tmp_path, BOTH, capsys)
    assert odd.endswith("raised warning odd: two models count 2 and 1 box in view of r1/front")
    assert gone.endswith("raised warning gone: r1 is offline")
    assert "resolved warning odd" in agreed
    assert summary == "2 rules, 0 intervals, 2 alerts"


async def test_what_goes_on_is_tried_whenever_it_began(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    some = [there(1, 1, "", is_open=True), there(2, 20), there(2, 50), HISTORY[-1]]
    await written(f"sqlite:///{tmp_path}/history.db", some, 99)
    raised, summary = await printed(tmp_path, BOTH, capsys, since="1970-01-01T00:00:40Z")
    assert "gone: r1 is offline" in raised
    assert summary == "2 rules, 1 intervals, 1 alerts"


async def test_history_that_does_not_tell_who_was_there_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    await written(url, list(HISTORY), 70)
    assert (await printed(tmp_path, BOTH, capsys))[1:] == [
        "silent, disagree: not tried: the history has no presence or disagreements"
    ]
    await written(url, [there(65, 65, "", is_open=True)], 90)
    note = (await printed(tmp_path, BOTH, capsys))[1]
    assert note.startswith("silent, disagree: tried from 1970-01-01T0")
    assert note.endswith(" on: before, the history has no presence or disagreements")
    assert len(await printed(tmp_path, BOTH, capsys, since="1970-01-01T00:01:06Z")) == 1
    assert (await printed(tmp_path, BOTH.replace("disagree", "silent"), capsys))[1] == note
    assert len(await printed(tmp_path, "rules: [{name: many, when: over, class: box, count: 9}]", capsys)) == 1


async def test_the_command_prints_what_would_have_been_raised(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"sqlite:///{tmp_path}/history.db"
    await written(url, list(HISTORY), 70)
    file = tmp_path / "rules.yaml"
    rules = "rules: [{name: many, when: over, class: box, count: 2}, {name: gone, when: silent}]"
    file.write_text(rules, encoding="utf-8")
    await run(RulesSettings(task="test", file=file, history=url))
    raised, resolved, summary, note = capsys.readouterr().out.splitlines()
    assert raised.endswith("raised warning many: 3 box in view of r1/front, over 2")
    assert "resolved warning many" in resolved
    assert summary == "2 rules, 5 intervals, 1 alerts"
    assert note.startswith("silent, disagree: not tried")
    file.write_text(rules.replace("count: 2", "count: many"), encoding="utf-8")
    with pytest.raises(RuleFileError, match=r"rules\.yaml: line 1: rule 1: count"):
        await run(RulesSettings(task="test", file=file, history=url))
    file.write_text("", encoding="utf-8")
    with pytest.raises(RuleFileError, match=r"rules\.yaml: line 1: the file is empty"):
        await run(RulesSettings(task="test", file=file, history=url))
    with pytest.raises(RuleFileError, match=r"none\.yaml: No such file"):
        await run(RulesSettings(task="test", file=tmp_path / "none.yaml", history=url))
    file.write_text(rules, encoding="utf-8")
    with pytest.raises(HistoryError, match="does not exist"):
        await run(RulesSettings(task="test", file=file, history=f"sqlite:///{tmp_path}/none.db"))
    assert not (tmp_path / "none.db").exists()


class Live:
    """A monitor's inventory, history and alerts. Two models look at r1's camera."""

    def __init__(self, url: str, rules: RuleFile) -> None:
        self.inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0), stale_ns=S))
        self.alerting = Alerting(rules, self.inventory, hears())
        self.history = HistoryWriter(HistorySettings(history=url), self.inventory, self.alerting.lead)
        self.alerts: list[Alert] = []

    def come(self, robot: str) -> None:
        self.inventory.robot_presence(robot, alive=True)
        self.inventory.camera_presence(CameraKey(robot, "front"), alive=True)

    def keep(self, alert: Alert) -> None:
        self.alerts.append(alert)
        self.history.alert(alert)

    async def see(self, for_s: float, *, ours: int, theirs: int) -> None:
        """Have both models look for a while."""
        until_s = time.monotonic() + for_s
        while time.monotonic() < until_s:
            for model, count in (("m", ours), ("n", theirs)):
                changes = self.inventory.see(seen(time.time_ns(), {"box": count}, model=model), time.time_ns())
                self.history.take(changes or ())
                self.alerting.take(changes or ())
            await asyncio.sleep(0.1)


@asynccontextmanager
async def living(url: str, rules: RuleFile) -> AsyncIterator[Live]:
    live = Live(url, rules)
    await live.history.restore()
    async with FakeNetwork().open_bus() as bus:
        running = [
            asyncio.create_task(live.history.run()),
            asyncio.create_task(
                live.alerting.run(bus, keep=live.keep, leads=lambda: live.history.status.leads),
            ),
        ]
        try:
            yield live
            await until(lambda: live.history.status.pending == 0)
        finally:
            for task in running:
                task.cancel()
            await asyncio.wait(running)


async def test_what_a_monitor_raised_is_what_its_history_raises(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "rules.yaml"
    text = BOTH.replace("]", MORE)
    file.write_text(text, encoding="utf-8")
    url, rules, settle_s = f"sqlite:///{tmp_path}/history.db", RuleFile(file), SETTLE_NS / S
    await rules.load()
    async with living(url, rules) as live:
        for robot in ("r1", "r2", "r3"):
            live.come(robot)
        await live.see(settle_s + 1, ours=2, theirs=2)
        await live.see(1.5, ours=2, theirs=1)
        live.inventory.robot_presence("r2", alive=False)
        await live.see(3, ours=2, theirs=2)
        live.inventory.robot_presence("r2", alive=True)
        await asyncio.sleep(4)  # nobody looks
        await live.see(1, ours=2, theirs=2)
        await live.see(2, ours=0, theirs=0)
        await live.see(1, ours=2, theirs=2)
        await asyncio.sleep(4)
        first = live.alerts
    async with living(url, rules) as live:
        live.come("r1")
        await live.see(settle_s + 2.5, ours=2, theirs=2)
        live.come("r3")
        await live.see(1, ours=2, theirs=2)
        raised = [*first, *live.alerts]
    *tried, _ = await printed(tmp_path, text, capsys)
    live_ones = [(alert.changed_ns, f"{alert.state} warning {alert.rule}: {alert.text}") for alert in raised]
    assert {said for _, said in live_ones} >= {
        "raised warning odd: two models count 2 and 1 box in view of r1/front",
        "raised warning mute: r1/front is silent",
        "raised warning left: box disappeared from view of r1/front",
        "resolved warning many: 2 box in view of r1/front, over 1",
        "resolved warning gone: r2 is offline",
        "raised warning gone: r3 is offline",
        "resolved warning gone: r3 is offline",
    }
    assert sorted(line.split(" ", 1)[1] for line in tried) == sorted(said for _, said in live_ones)
    for line, (at_ns, said) in zip(tried, live_ones, strict=True):
        assert abs(datetime.fromisoformat(line.split(" ", 1)[0]).timestamp() - at_ns / S) < settle_s + 1, said
