"""Several monitors with one database: one writes and raises alerts, and others take over."""

import time
from typing import Any

import pytest
from msgspec.structs import replace

from schemas.alerts import AlertState
from services.monitor.history.archive import Archive, HistoryQuery
from services.monitor.history.engine import own_name
from services.monitor.history.intervals import interval_of
from services.monitor.history.presence import MONITOR
from services.monitor.history.state import Act, HistoryError
from services.monitor.history.store import Store
from tests.schemas.results import alert
from tests.services.monitor.history.support.monitoring import attended, kept, monitoring
from tests.services.monitor.history.test_store import opened
from tests.services.monitor.inventory.seeing import S, going_on
from tests.waiting import until


async def test_a_robot_is_forgotten_at_all_monitors_of_a_database_where_it_is_gone(url: str) -> None:
    async with monitoring(url) as one:
        await until(lambda: one.history.status.leads)
        async with monitoring(url) as other:
            for robot in ("r1", "r2"):
                other.inventory.robot_presence(robot, alive=robot == "r2")
            for robot in ("r1", "r2"):
                one.history.forget(robot)
            await until(lambda: other.inventory.is_forgotten("r1"))
            assert not other.inventory.is_forgotten("r2")
            other.inventory.robot_presence("r1", alive=True)
            other.inventory.robot_presence("r1", alive=False)
            one.history.forget("r3")
            await until(lambda: other.inventory.is_forgotten("r3"))
            assert not other.inventory.is_forgotten("r1"), "it was back since"


async def test_a_robot_that_is_back_is_not_forgotten_once_more_when_another_monitor_leads(url: str) -> None:
    async with monitoring(url) as monitor, opened(url) as leader:
        await until(lambda: monitor.history.status.leads)
        monitor.inventory.forget("r1")
        monitor.history.forget("r1")
        await until(lambda: not monitor.history._forgotten)
        for alive in (True, False):
            monitor.inventory.robot_presence("r1", alive=alive)
        await monitor.history._fail(HistoryError("gone"))
        assert await leader.lead()
        await until(lambda: not monitor.history.status.leads)
        await leader.forget({"r2": time.time_ns()})
        await until(lambda: monitor.inventory.is_forgotten("r2"))
        assert not monitor.inventory.is_forgotten("r1")


async def test_of_two_monitors_one_writes_until_it_goes(url: str) -> None:
    async with monitoring(url) as second:
        async with monitoring(url) as first:
            await until(lambda: first.history.status.leads or second.history.status.leads)
            leader, other = (first, second) if first.history.status.leads else (second, first)
            assert leader.led == [[]]
            for monitor in (leader, other):
                monitor.see(1, box=1)
            leader.history.alert(alert())
            other.history.alert(alert(id_="of the other"))
            await until(lambda: leader.written() and other.written())
            assert not other.history.status.leads
        await until(lambda: second.history.status.leads)
        await until(second.written)
        assert len(await kept(url)) == 1
        runs = await attended(url, MONITOR)
        if second is other:
            assert [each.id for each in second.led[-1]] == [alert().id]
            assert [each.open for each in runs] == [False, True]
        else:
            assert [each.open for each in runs] == [True]


async def test_what_people_did_while_another_monitor_had_taken_the_lead_is_kept(url: str) -> None:
    async with monitoring(url) as monitor, opened(url) as leader:
        monitor.history.alert(alert(id_="of both"))
        await until(monitor.written)
        await monitor.history._fail(HistoryError("gone"))
        assert await leader.lead()
        monitor.history.alert(replace(alert(id_="of both"), state=AlertState.ACKNOWLEDGED))
        monitor.history.act(Act("of both", AlertState.ACKNOWLEDGED, "bob", 5))
        monitor.history.alert(alert(id_="its own"))
        monitor.inventory.forget("r1")
        monitor.history.forget("r1")
        heeded_ns = monitor.history._heeded_ns
        await until(lambda: not monitor.history.status.leads)
        await until(lambda: not monitor.history._alerts)
        ((robot, at_ns),) = (await leader.forgotten()).items()
        assert (robot, at_ns > heeded_ns) == ("r1", True)
        found = await Archive(url).alerts(HistoryQuery(), 9)
        assert {each.id: each.state for each in found} == {"of both": "raised", "its own": "resolved"}
        assert [act.who for act in await Archive(url).acts(["of both"])] == ["bob"]


async def test_whoever_led_until_the_database_was_gone_leads_when_it_is_back(url: str) -> None:
    async def refuse(*_: Any, **__: Any) -> None:
        raise HistoryError("gone")

    async with monitoring(url) as one:
        await until(lambda: one.history.status.leads)
        async with monitoring(url) as other:
            await until(lambda: bool(other.history.status.leader))
            for _ in range(3):
                with pytest.MonkeyPatch.context() as patch:
                    patch.setattr(Store, "write", refuse)
                    patch.setattr(Store, "lead", refuse)
                    await until(lambda: one.history.status.problem == other.history.status.problem == "gone")
                await until(lambda: not (one.history.status.problem or other.history.status.problem))
                assert (one.history.status.leads, other.history.status.leads) == (True, False)
        await until(one.written)


async def test_what_both_saw_when_one_of_two_monitors_took_over_is_kept_once(url: str) -> None:
    async with opened(url) as leader:
        assert await leader.lead()
        async with monitoring(url) as other:
            await until(lambda: other.history._follows)
            assert other.history.status.leader == own_name()
            now_ns = time.time_ns()
            other.see(1, now_ns - 9 * S, box=1, pallet=1, tree=1)
            seen_by_leader = [
                replace(interval_of(each), since_ns=each.since_ns - 7) for each in going_on(other.inventory)
            ]
            await leader.write(seen_by_leader, [], now_ns - S)
            other.see(2, box=1, tree=2)
            await leader.close()
            await until(lambda: other.history.status.leads and other.written())
            assert other.history.status.leader == ""
    found = {(each.name, each.count): each for each in await kept(url)}
    assert len(await kept(url)) == 4
    since_ns = seen_by_leader[0].since_ns
    assert {each.since_ns for of, each in found.items() if of != ("tree", 2)} == {since_ns}
    assert {of for of, each in found.items() if each.open} == {("box", 1), ("tree", 2)}


async def test_what_came_and_went_while_whoever_led_was_gone_without_a_word_is_kept(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = 0

    async def lead(store: Store) -> bool:
        nonlocal asked
        asked += 1
        return await really_lead(store)

    async with opened(url) as leader:
        assert await leader.lead()
        await leader.write([], [], time.time_ns() - S)
        really_lead = Store.lead
        monkeypatch.setattr(Store, "lead", lead)
        async with monitoring(url) as other:
            await until(lambda: asked > 0)
            other.see(1, box=1)
            other.see(2)
            before = asked
            await until(lambda: asked > before + 1)
            assert other.history.status.pending == 0, "as far as anybody knows"
            await leader.close()
            await until(lambda: other.history.status.leads and other.written())
    (box,) = await kept(url)
    assert (box.name, box.open) == ("box", False)
