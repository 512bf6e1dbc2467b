import asyncio
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from schemas.alerts import Action, Alert, AlertState
from schemas.keys import ACTIONS, ALERTS, CameraKey
from services.monitor.alerting import alerting as module
from services.monitor.alerting.alerting import SWEEP_S, look_at
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.rules.engine import RuleEngine
from services.monitor.rules.findings import CameraState
from services.monitor.rules.loading import load_rules
from services.monitor.rules.subjects import UnknownAlertError
from tests.schemas.results import alert, distances, known
from tests.services.monitor.alerting.rigging import Rig, ahead, received, rigged
from tests.services.monitor.inventory.seeing import FRONT, S, seen
from tests.waiting import until


@pytest.fixture
async def rig(tmp_path: Path) -> AsyncIterator[Rig]:
    async with rigged(tmp_path) as made:
        yield made


async def test_an_alert_reaches_its_robot_and_the_store_and_makes_the_robot_act(rig: Rig) -> None:
    async with received(rig.theirs, ALERTS, Alert) as alerts, received(rig.theirs, ACTIONS, Action) as actions:
        rig.see()
        rig.see(pallet=1)
        await until(lambda: bool(alerts) and bool(actions))
        assert alerts == rig.kept == rig.alerting.alerts()
        (action,) = actions
        assert isinstance(action, Action)
        assert action.robot_ns == ahead("r1", action.sent_ns)
        assert (action.name, action.payload, action.rule) == ("pick_up", "pallet at r1/front", "a pallet")
        rig.alerting.acknowledge(rig.kept[0].id)
        rig.see()
        await until(lambda: len(alerts) == 3)
        assert alerts == rig.kept
        assert [state for _, state in rig.states()] == ["raised", "acknowledged", "resolved"]
        assert len(actions) == 1


async def test_what_went_while_its_camera_was_lost_is_over_once_the_camera_is_back(rig: Rig) -> None:
    rig.see()
    rig.see(pallet=1)
    await until(lambda: rig.states() == [("a pallet", AlertState.RAISED)])
    rig.inventory.camera_presence(FRONT, alive=False)
    await asyncio.sleep(0.5)
    rig.alerting.take(rig.inventory.tick(time.time_ns() + 3_600 * S))
    rig.inventory.camera_presence(FRONT, alive=True)
    await asyncio.sleep(0.5)
    assert len(rig.kept) == 1, "nobody knows"
    rig.see()
    rig.see()
    await until(lambda: rig.states()[1:] == [("a pallet", AlertState.RESOLVED)])
    rig.see(pallet=1)
    await until(lambda: rig.states()[2:] == [("a pallet", AlertState.RAISED)])


async def test_distances_and_silence_are_alerted(rig: Rig) -> None:
    rig.see(box=1)
    rig.see(box=1)
    rig.inventory.measure(distances(known("box", 1.5), seq=1), time.time_ns())
    rig.alerting.measured(FRONT)
    await until(lambda: ("too near", AlertState.RAISED) in rig.states())
    rig.inventory.robot_presence("r1", alive=False)
    await until(lambda: ("lost", AlertState.RAISED) in rig.states())
    rig.inventory.robot_presence("r1", alive=True)
    await until(lambda: ("lost", AlertState.RESOLVED) in rig.states())


async def test_nobody_misses_a_robot_that_was_forgotten_until_it_is_back(tmp_path: Path) -> None:
    rules = """
rules:
  - {name: lost, when: silent, robots: [r1]}
  - {name: lost for long, when: silent, for_s: 3}
  - {name: blind for long, when: silent, cameras: [front], for_s: 3}
"""
    async with rigged(tmp_path, text=rules) as rig:
        rig.see()
        rig.see()
        rig.inventory.robot_presence("r2", alive=True)
        rig.inventory.robot_presence("r1", alive=False)
        await until(lambda: rig.states() == [("lost", AlertState.RAISED)])
        rig.alerting.resolve(rig.kept[0].id)
        rig.inventory.forget("r1")
        rig.inventory.robot_presence("r2", alive=False)
        rig.rules.book = load_rules(rules + "  - {name: new, when: silent, robots: [r1]}\n")
        await until(lambda: ("lost for long", AlertState.RAISED) in rig.states())
        assert [(each.rule, each.robot) for each in rig.kept[2:]] == [("lost for long", "r2")]
        rig.inventory.robot_presence("r1", alive=True)
        await until(lambda: "r1" not in rig.alerting._news.robots)
        rig.inventory.robot_presence("r1", alive=False)
        await until(lambda: ("new", AlertState.RAISED) in rig.states())


async def test_a_camera_that_joins_says_nothing_only_when_it_stays_without_lists(rig: Rig) -> None:
    rig.rules.book = load_rules(
        "rules: [{name: mute, when: silent, cameras: ['*']}, {name: boxes, when: over, class: box, count: 0}]"
    )
    rear = CameraKey("r1", "rear")
    rig.inventory.camera_presence(rear, alive=True)
    rig.see(box=1)
    await asyncio.sleep(3 * SWEEP_S)
    seeing = asyncio.create_task(keep_seeing(rig))
    await until(lambda: ("mute", AlertState.RAISED) in rig.states())
    seeing.cancel()
    assert {(each.rule, each.camera, each.state) for each in rig.kept} == {
        ("boxes", "front", AlertState.RAISED),
        ("mute", "rear", AlertState.RAISED),
    }


async def keep_seeing(rig: Rig) -> None:
    while True:
        rig.see(box=1)
        await asyncio.sleep(0.1)


async def test_what_there_was_no_room_for_is_alerted_once_there_is(tmp_path: Path) -> None:
    async with rigged(tmp_path, offer_s=0, most_subjects=1) as rig:
        for robot in ("r1", "r2"):
            rig.inventory.robot_presence(robot, alive=True)
            rig.inventory.robot_presence(robot, alive=False)
        await until(lambda: len(rig.kept) == 1)
        await asyncio.sleep(0.5)
        assert [each.state for each in rig.kept] == [AlertState.RAISED]
        rig.inventory.robot_presence(rig.kept[0].robot, alive=True)
        await until(lambda: len(rig.kept) == 3)
        assert [each.state for each in rig.kept[1:]] == [AlertState.RESOLVED, AlertState.RAISED]
        assert {each.robot for each in rig.alerting.alerts()} == {"r1", "r2"} - {rig.kept[0].robot}


async def test_a_rule_that_goes_with_its_webhook_resolves_its_alert(rig: Rig) -> None:
    webhook = "webhooks: {ops: {url: 'http://127.0.0.1:1/', secret: a long secret}}\n"
    rig.rules.book = load_rules(webhook + "rules: [{name: any, when: appears, class: box, webhooks: [ops]}]")
    await asyncio.sleep(0.3)
    rig.see()
    rig.see(box=1)
    await until(lambda: rig.states() == [("any", AlertState.RAISED)])
    rig.rules.book = load_rules("rules: []")
    await until(lambda: rig.states()[1:] == [("any", AlertState.RESOLVED)])
    await asyncio.sleep(0.2)
    assert rig.alerting.alerts() == []


async def test_a_monitor_that_does_not_lead_raises_nothing(rig: Rig) -> None:
    rig.leads = False
    await asyncio.sleep(0.3)
    rig.see()
    rig.see(pallet=1)
    rig.alerting.measured(FRONT)
    with pytest.raises(UnknownAlertError, match="another monitor"):
        rig.alerting.resolve("a1")
    rig.leads = True
    before = msgspec.structs.replace(alert(id_="before", robot="r9"), name="box")
    rig.alerting.lead([before], since_ns=time.time_ns())
    assert [each.id for each in rig.alerting.alerts()] == ["before"]
    assert rig.alerting.escalate("before").state is AlertState.ESCALATED
    await until(lambda: bool(rig.kept))
    assert rig.states() == [("too near", AlertState.ESCALATED)]


async def test_a_camera_that_no_rule_is_about_is_looked_at_when_there_is_news(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[CameraKey] = []

    def concerns(_: RuleEngine, key: CameraKey) -> bool:
        asked.append(key)
        return False

    monkeypatch.setattr(RuleEngine, "concerns", concerns)
    for _ in range(2):
        rig.see(box=1)
        rig.see(box=2)
        await until(lambda: asked)
        await asyncio.sleep(2 * SWEEP_S)
        asked.clear()
        await asyncio.sleep(2 * SWEEP_S)
        assert asked == []


def test_a_look_is_of_what_is_known_now() -> None:
    inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0)))
    inventory.robot_presence("r1", alive=True)
    inventory.camera_presence(FRONT, alive=True)
    for seq in (1, 2):
        inventory.see(seen(seq, {"box": 2}), seq * S)
    inventory.measure(distances(known("box", 1.5), seq=1), 2 * S)
    camera = inventory.camera(FRONT)
    assert camera
    look = look_at(inventory, camera, 3 * S)
    assert (look.available, look.counts, look.nearest, look.disagreements) == (True, {"box": 2}, {"box": 1.625}, {})
    later = look_at(inventory, camera, 9 * S)
    assert (later.available, later.counts, later.nearest) == (False, {"box": 2}, {})


@pytest.mark.parametrize("appear", [(4, 0), (1, S // 2)])
@pytest.mark.parametrize(("boxes", "raised"), [(3, []), (0, [("too few", AlertState.RAISED)])])
async def test_there_are_too_few_only_once_those_that_are_there_would_count(
    tmp_path: Path, appear: tuple[int, int], boxes: int, raised: list[tuple[str, AlertState]]
) -> None:
    lists, long_ns = appear
    under = "rules: [{name: too few, when: under, class: box, count: 2}]"
    async with rigged(tmp_path, text=under, appear=appear) as rig:
        for _ in range(max(2, lists - 1)):
            rig.see(box=boxes)
        await asyncio.sleep(2 * SWEEP_S)
        assert rig.kept == []
        await asyncio.sleep(long_ns / S)
        rig.see(box=boxes)
        await asyncio.sleep(3 * SWEEP_S)
        assert rig.states() == raised


async def test_a_camera_that_says_nothing_is_not_looked_at_again_and_again(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[CameraKey] = []

    def look(inventory: Inventory, camera: CameraView, *known: Any, **more: Any) -> CameraState:
        looks.append(camera.key)
        return look_at(inventory, camera, *known, **more)

    rig.see(box=1)
    await asyncio.sleep(3 * SWEEP_S)
    monkeypatch.setattr(module, "look_at", look)
    await asyncio.sleep(3 * SWEEP_S)
    assert looks == []
    rig.see(box=1)
    await until(lambda: looks == [FRONT])
