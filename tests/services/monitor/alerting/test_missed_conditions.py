"""Alerts about conditions that were over before anybody could look."""

import asyncio
import time
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec
import pytest

from schemas.alerts import Action, Alert, AlertState
from schemas.keys import ACTIONS, ALERTS
from tests.schemas.results import alert
from tests.services.monitor.alerting.rigging import Rig, received, rigged
from tests.services.monitor.inventory.seeing import S
from tests.waiting import until

RULES = """
rules:
  - {name: came, when: appears, class: pallet, action: {name: pick_up, payload: ""}}
  - {name: many, when: over, class: box, count: 2, for_s: 3}
"""

RAISED, RESOLVED = AlertState.RAISED, AlertState.RESOLVED


@pytest.fixture
async def rig(tmp_path: Path) -> AsyncIterator[Rig]:
    async with rigged(tmp_path, text=RULES) as made:
        await asyncio.sleep(0.3)  # it has looked around
        yield made


async def stand_by(rig: Rig) -> int:
    """Leave the lead to another monitor; return the time from then on, epoch nanoseconds."""
    rig.leads = False
    await asyncio.sleep(0.3)
    return time.time_ns()


def take_over(rig: Rig, since_ns: int, *theirs: Alert) -> None:
    """Lead again. since_ns: when the other monitor wrote last. theirs: its open alerts."""
    rig.leads = True
    rig.alerting.lead(theirs, since_ns=since_ns)


async def test_what_late_lists_tell_to_have_passed_is_raised_and_resolved_with_its_own_times(rig: Rig) -> None:
    now_ns = time.time_ns()
    rig.see(ago_s=20)
    rig.see(ago_s=15, pallet=1, box=3)
    rig.see(ago_s=11, box=3)
    rig.see(ago_s=10, box=1)
    await until(lambda: len(rig.kept) == 4)
    assert rig.states() == [("came", RAISED), ("came", RESOLVED), ("many", RAISED), ("many", RESOLVED)]
    came_s, went_s, many_s, over_s = ((each.changed_ns - now_ns) / S for each in rig.kept)
    assert came_s == pytest.approx(-15, abs=0.5)
    assert went_s == pytest.approx(-15, abs=0.5), "the last list that had it"
    assert many_s == pytest.approx(-12, abs=0.5), "it had to hold for three seconds"
    assert over_s == pytest.approx(-10, abs=0.5)
    assert rig.alerting.alerts() == []


async def test_no_robot_acts_on_what_has_passed(rig: Rig) -> None:
    async with received(rig.theirs, ALERTS, Alert) as alerts, received(rig.theirs, ACTIONS, Action) as actions:
        rig.see(ago_s=20)
        rig.see(ago_s=15, pallet=1)
        rig.see(ago_s=10)
        await until(lambda: [each.state for each in alerts if isinstance(each, Alert)] == [RAISED, RESOLVED])
        rig.see(pallet=1)
        await until(lambda: bool(actions))
        assert [each.sent_ns for each in actions if isinstance(each, Action)] == [rig.kept[-1].changed_ns]


async def test_what_the_other_monitor_raised_is_over_when_it_comes_again(rig: Rig) -> None:
    now_ns = await stand_by(rig)
    rig.see(ago_s=20)
    rig.see(ago_s=18, box=3)
    rig.see(ago_s=8, box=1)
    rig.see(ago_s=7, box=4)
    rig.see(ago_s=2, box=1)
    raised_ns = now_ns - 15 * S
    theirs = msgspec.structs.replace(alert(id_="theirs"), rule="many", name="box", raised_ns=raised_ns)
    take_over(rig, now_ns - 10 * S, theirs)
    await until(lambda: len(rig.kept) == 3)
    await asyncio.sleep(0.3)
    assert sorted(rig.states()) == [("many", RAISED), ("many", RESOLVED), ("many", RESOLVED)]
    assert len({each.id for each in rig.kept}) == 2


async def test_a_cooldown_holds_in_hindsight(tmp_path: Path) -> None:
    text = "rules: [{name: came, when: appears, class: pallet, cooldown_s: 8}]"
    async with rigged(tmp_path, text=text) as rig:
        await asyncio.sleep(0.3)
        for ago_s in (30, 25, 20, 15):
            rig.see(ago_s=ago_s)
            rig.see(ago_s=ago_s - 1, pallet=1)
        rig.see(ago_s=10)
        rig.see(box=1)
        await until(lambda: len(rig.kept) == 4)
        await asyncio.sleep(0.3)
        raised = [each.raised_ns for each in rig.kept if each.state is RAISED]
        assert [(each - raised[0]) / S for each in raised] == pytest.approx([0, 10], abs=0.5)


async def test_a_clock_that_is_set_back_keeps_nothing_back(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.see()
    rig.alerting.lead((), since_ns=time.time_ns())
    rig.see(box=1)
    hour_ns, now_ns = 3_600 * S, time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: now_ns() - hour_ns)
    rig.inventory.set_back(time.time_ns())
    rig.see(box=1, pallet=1)
    await until(lambda: rig.states() == [("came", RAISED)])


async def test_what_an_operator_resolved_is_not_raised_again_when_it_is_over(rig: Rig) -> None:
    rig.see()
    rig.see(pallet=1)
    await until(lambda: rig.states() == [("came", RAISED)])
    rig.alerting.resolve(rig.kept[0].id)
    await asyncio.sleep(1.2)
    rig.see(ago_s=1.1)
    rig.see(box=1, pallet=0)
    await asyncio.sleep(0.5)
    assert rig.states() == [("came", RAISED), ("came", RESOLVED)]


async def test_an_alert_that_goes_on_over_a_restart_is_one_however_its_count_moved(rig: Rig) -> None:
    now_ns = await stand_by(rig)
    rig.see(ago_s=40)
    rig.see(ago_s=39, box=3)
    before = msgspec.structs.replace(alert(id_="before"), rule="many", name="box", raised_ns=now_ns - 36 * S)
    take_over(rig, now_ns - 30 * S, before)
    rig.see(ago_s=20, box=5)
    rig.see(ago_s=5, box=1)
    await until(lambda: bool(rig.kept))
    await asyncio.sleep(0.3)
    assert [(each.id, each.state) for each in rig.kept] == [("before", RESOLVED)]


async def test_after_one_in_hindsight_a_cooldown_holds_for_what_is_seen_now(tmp_path: Path) -> None:
    text = "rules: [{name: came, when: appears, class: pallet, cooldown_s: 60}]"
    async with rigged(tmp_path, text=text) as rig:
        await asyncio.sleep(0.3)
        rig.see(ago_s=20)
        rig.see(ago_s=19, pallet=1)
        rig.see(ago_s=10)
        rig.see(pallet=1)
        await until(lambda: len(rig.kept) == 2)
        await asyncio.sleep(0.5)
        assert rig.states() == [("came", RAISED), ("came", RESOLVED)]


async def test_too_short_is_not_enough_in_hindsight_either(rig: Rig) -> None:
    rig.see(ago_s=20)
    rig.see(ago_s=15, box=3)
    rig.see(ago_s=12.5, box=1)
    rig.see(pallet=1)
    await until(lambda: rig.states() == [("came", RAISED)])


async def test_what_was_looked_at_in_time_is_raised_once(rig: Rig) -> None:
    rig.see()
    rig.see(pallet=1)
    await until(lambda: rig.states() == [("came", RAISED)])
    rig.see(ago_s=-5)  # of which one hears late: the clocks differ
    await until(lambda: rig.states()[1:] == [("came", RESOLVED)])
    await asyncio.sleep(0.3)
    assert len({each.id for each in rig.kept}) == 1


async def test_what_still_holds_is_raised_and_stays(rig: Rig) -> None:
    rig.see(ago_s=20)
    rig.see(ago_s=15, pallet=1)
    rig.see(pallet=1)
    await until(lambda: rig.states() == [("came", RAISED)])
    assert [each.rule for each in rig.alerting.alerts()] == ["came"]


async def test_what_passed_before_the_other_monitor_wrote_last_is_its_own(rig: Rig) -> None:
    now_ns = await stand_by(rig)
    rig.see(ago_s=20)
    rig.see(ago_s=18, pallet=1)
    rig.see(ago_s=16)
    rig.see(ago_s=8, pallet=2)
    rig.see(ago_s=6)
    take_over(rig, now_ns - 10 * S)
    await until(lambda: rig.states() == [("came", RAISED), ("came", RESOLVED)])
    assert rig.kept[0].raised_ns == pytest.approx(now_ns - 8 * S, abs=S)


async def test_what_the_other_monitor_raised_is_resolved_once(rig: Rig) -> None:
    now_ns = await stand_by(rig)
    rig.see(ago_s=20)
    rig.see(ago_s=18, pallet=1)
    rig.see(ago_s=8)
    theirs = msgspec.structs.replace(alert(id_="theirs", robot="r1"), rule="came", name="pallet")
    take_over(rig, now_ns - 10 * S, theirs)
    await until(lambda: bool(rig.kept))
    await asyncio.sleep(0.3)
    assert [(each.id, each.state) for each in rig.kept] == [("theirs", RESOLVED)]
