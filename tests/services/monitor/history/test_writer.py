import asyncio
import time
from pathlib import Path
from typing import Any

import pytest

from services.monitor.history import writer as module
from services.monitor.history.intervals import Disagreement
from services.monitor.history.presence import MONITOR
from services.monitor.history.settings import NONE, HistorySettings, default_url
from services.monitor.history.state import HistoryStatus
from services.monitor.history.store import Store
from services.monitor.inventory.sighting import ChangeKind
from services.monitor.liveness import POSE_LIVE_NS
from services.monitor.map.last_seen import FORGET_NS, LastPoses
from services.monitor.map.pose import Pose
from tests.schemas.results import alert
from tests.services.monitor.history.support.monitoring import Monitor, attended, kept, monitoring, noted
from tests.services.monitor.history.test_store import opened
from tests.services.monitor.inventory.seeing import FRONT, S, going_on, seen
from tests.waiting import until


async def test_what_is_in_view_goes_on_over_a_restart(url: str) -> None:
    async with monitoring(url) as monitor:
        monitor.see(1, box=1)
        monitor.history.alert(alert())
        await until(monitor.written)
        monitor.see(2, box=1, pallet=2)
    (box, pallet) = await kept(url)
    assert (box.name, box.open, pallet.name, pallet.open) == ("box", True, "pallet", True)
    async with monitoring(url) as monitor:
        assert {each.name: each.count for each in going_on(monitor.inventory)} == {"box": 1, "pallet": 2}
        await until(lambda: monitor.led == [[alert()]])
        monitor.see(3, box=1)
        await until(monitor.written)
    box, pallet = await kept(url)
    assert (box.open, pallet.open, pallet.count) == (True, False, 2)
    assert pallet.until_ns >= pallet.since_ns


async def test_who_was_there_goes_on_over_a_restart_if_it_comes_back_at_once(url: str) -> None:
    async with monitoring(url) as monitor:
        for robot in ("r1", "r2"):
            monitor.inventory.robot_presence(robot, alive=True)
        await noted(monitor)
        await until(monitor.written)
    (r1,), (r2,), (run,) = [await attended(url, place) for place in (("r1", ""), ("r2", ""), MONITOR)]
    assert (r1.open, r2.open, run.open) == (True, True, True)
    async with monitoring(url) as monitor:
        assert set(monitor.inventory.recalled()) >= {"r1", "r2"}, "without a single sighting"
        monitor.inventory.robot_presence("r1", alive=True)
        await noted(monitor)
        await until(monitor.written)
    (again,), (gone,), (ended, other) = [await attended(url, place) for place in (("r1", ""), ("r2", ""), MONITOR)]
    assert (again.open, again.since_ns) == (True, r1.since_ns)
    assert (gone.open, gone.since_ns) == (False, r2.since_ns)
    assert (ended.open, ended.since_ns, other.open) == (False, run.since_ns, True)
    assert ended.until_ns == gone.until_ns < other.since_ns < again.until_ns


async def test_a_robot_that_was_forgotten_stays_so_over_a_restart_until_it_is_back(url: str) -> None:
    async with monitoring(url) as monitor:
        for robot in ("r1", "r2"):
            monitor.inventory.robot_presence(robot, alive=True)
        monitor.see(1, box=1)
        await noted(monitor)
        for robot in ("r1", "r2"):
            monitor.inventory.robot_presence(robot, alive=False)
        monitor.inventory.forget("r1")  # before it is even noted that it went
        monitor.history.forget("r1")
        await noted(monitor)
        await until(monitor.written)
    async with monitoring(url) as monitor:
        assert (set(monitor.inventory.recalled()), monitor.inventory.in_order()) == ({"marker", "r2"}, ())
        monitor.inventory.robot_presence("r1", alive=True)
        assert monitor.inventory.in_order() == (FRONT,)
        await noted(monitor)
        await until(monitor.written)
    async with monitoring(url) as monitor:
        await until(lambda: monitor.history.status.leads)
        assert set(monitor.inventory.recalled()) == {"marker", "r1", "r2"}
        assert monitor.inventory.in_order() == (FRONT,)
    assert [each.name for each in await kept(url)] == ["box"], "its history stays"


async def test_where_robots_were_is_known_after_a_restart(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = time.time_ns()
    old, here, there = (
        Pose(9.0, 2.0, 0.5, now_ns - 2 * FORGET_NS),
        Pose(1.0, 2.0, 0.5, now_ns),
        Pose(3.0, 2.0, 0.5, now_ns + 1),
    )
    async with monitoring(url) as monitor:
        monitor.places.stand({"r1": here, "r2": old})
        await until(lambda: monitor.history.status.leads)
    async with monitoring(url) as monitor:
        assert monitor.places.poses == {"r1": here}
        last = LastPoses()
        last.take_seen(monitor.places.poses)
        later_ns = now_ns + POSE_LIVE_NS + 1
        assert [(robot.pose, robot.live) for robot in last.robots(later_ns, {"r1"})] == [(here, False)]
        await until(lambda: monitor.history.status.leads)
    monkeypatch.setattr(module, "WRITE_S", 0.0)
    async with monitoring(url) as monitor, opened(url) as store, asyncio.timeout(60):
        monitor.places.stand({"r1": there})
        while await store.poses(now_ns) != {"r1": there}:  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(module.FLUSH_S)


async def test_what_models_disagree_about_is_kept(url: str) -> None:
    async with monitoring(url) as monitor:
        monitor.inventory.robot_presence("r1", alive=True)
        monitor.inventory.camera_presence(FRONT, alive=True)
        for seq in (1, 2):
            monitor.see(2 * seq, box=2)
            monitor.history.take(monitor.inventory.see(seen(2 * seq + 1, {"box": 1}, model="n"), time.time_ns()) or ())
        async with opened(url) as store, asyncio.timeout(60):
            while not (found := await store.select(Disagreement)):  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(module.FLUSH_S)
    (one,) = found
    assert (one.key, one.name, one.open) == (FRONT, "box", True)
    assert (one.count, one.model, one.other_count, one.other_model) == (2, "m", 1, "n")


async def test_a_silent_cameras_sightings_end_when_they_were_seen_last_and_go_on_when_it_speaks(url: str) -> None:
    async with monitoring(url) as monitor:
        then_ns = time.time_ns() - 10 * S
        monitor.see(1, then_ns, box=1)
        await until(monitor.written)
        (box,) = await kept(url)
        assert (box.since_ns, box.until_ns, box.open) == (then_ns, then_ns, False)
        monitor.see(2, box=1)
        async with asyncio.timeout(60):
            while not box.open:
                await asyncio.sleep(module.FLUSH_S)
                (box,) = await kept(url)
        assert box.since_ns == then_ns
        assert box.until_ns > then_ns + 9 * S


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch) -> list[Store]:
    """The stores that were closed."""
    stores: list[Store] = []
    close = Store.close

    async def closing(store: Store) -> None:
        await close(store)
        stores.append(store)

    monkeypatch.setattr(Store, "close", closing)
    return stores


async def test_a_monitor_that_is_ended_before_it_has_begun_lets_go_of_the_database(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, closed: list[Store]
) -> None:
    reading = asyncio.Event()

    async def never(_: Store) -> None:
        reading.set()
        await asyncio.Event().wait()

    monkeypatch.setattr(Store, "forgotten", never)
    restoring = asyncio.create_task(Monitor(f"sqlite:///{tmp_path}/history.db").history.restore())
    await reading.wait()
    restoring.cancel()
    await asyncio.wait([restoring])
    assert (restoring.cancelled(), len(closed)) == (True, 1)


async def test_a_monitor_that_cannot_begin_lets_go_of_the_database(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, closed: list[Store]
) -> None:
    def refuse(_: object) -> None:
        raise ValueError("of the inventory")

    monitor = Monitor(f"sqlite:///{tmp_path}/history.db")
    monkeypatch.setattr(monitor.inventory, "restore", refuse)
    with pytest.raises(ValueError, match="of the inventory"):
        await monitor.history.restore()
    assert len(closed) == 1


async def test_a_monitor_that_ends_while_it_writes_finishes_what_it_began(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, ended = asyncio.Event(), []
    write = Store.write

    async def writing(store: Store, *some: Any) -> None:
        begun.set()
        await write(store, *some)
        ended.append(some)

    monkeypatch.setattr(Store, "write", writing)
    async with monitoring(url) as monitor:
        monitor.see(1, box=1)
        await begun.wait()
    assert [len(some) for some in ended] == [4, 4], "the one that was under way, and the last one"
    assert [each.name for each in await kept(url)] == ["box"]


async def test_a_monitor_that_is_told_to_end_again_and_again_still_does_one_thing_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, begun, may_end = f"sqlite:///{tmp_path}/history.db", asyncio.Event(), asyncio.Event()
    said: list[str] = []
    write = Store.write

    async def writing(store: Store, *some: Any) -> None:
        said.append("begins")
        begun.set()
        await may_end.wait()
        await write(store, *some)
        said.append("ends")

    monkeypatch.setattr(Store, "write", writing)
    monitor = Monitor(url)
    await monitor.history.restore()
    monitor.see(1, box=1)
    running = asyncio.create_task(monitor.history.run())
    await begun.wait()
    for _ in range(3):
        running.cancel()
        await asyncio.sleep(0.01)
    may_end.set()
    await asyncio.wait([running])
    assert said == ["begins", "ends"] * 2
    assert [each.name for each in await kept(url)] == ["box"]


async def test_before_the_database_was_first_written_to_nothing_is_wrong(url: str) -> None:
    async with monitoring(url) as monitor:
        assert monitor.history.status.problem == ""
        monitor.see(1, box=1)
        await until(monitor.written)


async def test_no_history_is_no_problem() -> None:
    async with monitoring(NONE) as monitor:
        monitor.see(1, box=1)
        monitor.history.alert(alert())
        assert monitor.history.status == HistoryStatus(problem="", leads=True, pending=0, lost=0)
        assert monitor.led == [[]]


def test_history_is_kept_unless_told_otherwise() -> None:
    assert default_url().startswith("sqlite:////")
    assert HistorySettings().history == default_url()
    for wrong in ("history.db", "mysql://a/b", "", "postgresql://\udcff@host/db"):
        with pytest.raises(ValueError, match="write it like"):
            HistorySettings(history=wrong)


def test_changes_that_are_lost_end() -> None:
    monitor = Monitor("sqlite:////nowhere")
    monitor.see(1, S, box=1)
    lost = monitor.inventory.tick(100 * S)
    assert [change.kind for change in lost] == [ChangeKind.LOST]
    monitor.history.take(lost)
    assert monitor.history.status.pending == 1
    camera = monitor.inventory.camera(FRONT)
    assert camera
    assert camera.lost
