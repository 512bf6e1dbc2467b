"""The world model over a real router: one inventory from several robots, told, asked for, kept and taken over."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import replace
from pathlib import Path
from time import time, time_ns

import msgspec
import pytest

from bus import LATEST, QUEUE, Bus, BusError, QoS, RefusedError, Subscription
from schemas import codec
from schemas.distances import CameraView
from schemas.keys import NEARBY, CameraKey, RobotStreamKey, Stream
from schemas.worker_keys import MAX_WEIGHT, WorkerAlive, WorldStream, world_key
from schemas.world import (
    ChangeKind,
    FloorLooks,
    NearbyObjects,
    SiteStatus,
    WorldAnswer,
    WorldChange,
    WorldChanges,
    WorldRequest,
)
from services.monitor.fleet import Fleet
from services.monitor.history.archive import HistoryQuery
from services.monitor.monitor import Monitor
from services.monitor.process import running, watch_fleet
from services.monitor.settings import MonitorSettings
from services.monitor.world.site_objects import World
from services.monitor.world.zones import Zone, ZoneCount
from services.toolbox.demo.children import Child
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig
from tests.services.worldmodel.scene import Camera, Thing, view
from tests.waiting import until

SITE = "hall-2"
PERIOD_S = 0.1
THINGS = [Thing(3.5, -1.0), Thing(3.5, 0.2, (1.2, 0.8, 0.14), name="pallet"), Thing(4.5, 1.2)]
CAMERAS = [Camera(robot="r1"), Camera(0.3, 0.4, robot="r2")]


class Robots:
    """Robots that look at things and send their views; `things` may change."""

    def __init__(self, things: Sequence[Thing]) -> None:
        self.things = list(things)

    @asynccontextmanager
    async def looking(self, bus: Bus, cameras: Sequence[Camera] = CAMERAS) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            publishers = [
                await stack.enter_async_context(
                    bus.publisher(
                        CameraKey(camera.robot, camera.name).stream(Stream.VIEW),
                        QoS.IMAGE,
                        encoding=codec.encoding(CameraView),
                    )
                )
                for camera in cameras
            ]

            async def send() -> None:
                while True:
                    for camera, publisher in zip(cameras, publishers, strict=True):
                        publisher.put(codec.encode(view(self.things, camera, time())))
                    await asyncio.sleep(PERIOD_S)

            sending = asyncio.create_task(send())
            try:
                yield
            finally:
                sending.cancel()
                await asyncio.wait([sending])


async def asked(bus: Bus, request: WorldRequest | None = None) -> WorldAnswer:
    payload = b"" if request is None else codec.encode(request)
    reply = await bus.request(
        world_key(SITE, WorldStream.OBJECTS), payload, encoding=codec.encoding(WorldRequest), timeout_s=5
    )
    return codec.decode(WorldAnswer, reply.payload, reply.encoding)


async def until_known(bus: Bus, count: int) -> WorldAnswer:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            with suppress(BusError):  # nobody serves it yet, or not any more
                answer = await asked(bus)
                if len(answer.objects) == count:
                    return answer
            await asyncio.sleep(0.1)


async def start(central: FleetRig, worker: str, *options: str) -> Child:
    return await central.start("worldmodel", "--sites", f"{SITE}=r1+r2", "--worker", worker, *options)


async def test_one_inventory_of_what_two_robots_see_is_told_and_asked_for() -> None:
    robots = Robots(THINGS)
    async with fleet_rig() as central, robots.looking(central.bus):
        await start(central, "w1", "--refresh-s", "1")
        answer = await until_known(central.bus, len(THINGS))
        async with central.bus.subscribe(
            world_key(SITE, WorldStream.CHANGES), QUEUE(1000), history=True, recover=100
        ) as changes:
            told = await first_changes(changes, len(THINGS))
            assert {change.object.id for change in told} == {each.id for each in answer.objects}
            robots.things = THINGS[1:]
            gone = await change_of(changes, ChangeKind.GONE)
            assert gone.object.at == pytest.approx((3.5, -1.0, 0.2), abs=0.1)
            assert gone.by in {"r1", "r2"}
        (pallet,) = (await asked(central.bus, WorldRequest(name="pallet"))).objects
        assert {seer.robot for seer in pallet.seen_by} == {"r1", "r2"}
        assert (pallet.site, pallet.velocity) == (SITE, None)
        nowhere = WorldRequest(region=[(10, 10), (11, 10), (11, 11)])
        assert (await asked(central.bus, nowhere)).objects == []
        with pytest.raises(RefusedError, match="unknown field"):
            await central.bus.request(
                world_key(SITE, WorldStream.OBJECTS),
                msgspec.msgpack.encode({"clas": "box"}),
                encoding=codec.encoding(WorldRequest),
                timeout_s=5,
            )
        reply = await central.bus.request(world_key(SITE, WorldStream.FLOOR), timeout_s=5)
        floor = codec.decode(FloorLooks, reply.payload, reply.encoding)
        assert floor.columns * floor.rows > 0
        assert min(memoryview(floor.ages).cast("H")) < 30


async def first_changes(changes: Subscription, count: int) -> list[WorldChange]:
    found: list[WorldChange] = []
    number = None
    async with asyncio.timeout(PATIENCE_S):
        async for sample in changes:
            message = codec.decode(WorldChanges, sample.payload, sample.encoding)
            assert number in {None, message.first}
            number = message.first + len(message.changes)
            found += [change for change in message.changes if change.kind is ChangeKind.APPEARED]
            if len(found) == count:
                break
    return found


async def change_of(changes: Subscription, kind: ChangeKind) -> WorldChange:
    async with asyncio.timeout(PATIENCE_S):
        async for sample in changes:
            message = codec.decode(WorldChanges, sample.payload, sample.encoding)
            for change in message.changes:
                if change.kind is kind:
                    return change
    raise AssertionError("the bus was closed")


async def test_a_robot_is_told_what_others_saw_near_it() -> None:
    async with fleet_rig() as central, Robots(THINGS).looking(central.bus):
        await start(central, "w1")
        await until_known(central.bus, len(THINGS))
        key = str(RobotStreamKey("r2", NEARBY))
        async with central.bus.subscribe(key, LATEST) as samples, asyncio.timeout(PATIENCE_S):
            sample = await anext(samples)
        near = codec.decode(NearbyObjects, sample.payload, sample.encoding)
        assert (near.robot, near.site, near.frame_id) == ("r2", SITE, "map")
        assert len(near.objects) == len(THINGS)


async def test_ids_outlive_a_restart(tmp_path: Path) -> None:
    async with fleet_rig() as central, Robots(THINGS).looking(central.bus):
        first = await start(central, "w1", "--state", str(tmp_path))
        before = await until_known(central.bus, len(THINGS))
        first.process.terminate()
        await first.process.wait()
        await start(central, "w2", "--state", str(tmp_path))
        after = await until_known(central.bus, len(THINGS))
        assert after.epoch != before.epoch
        assert {each.id for each in after.objects} == {each.id for each in before.objects}


async def test_another_worker_takes_a_site_over_with_its_ids() -> None:
    async with fleet_rig() as central, Robots(THINGS).looking(central.bus):
        first = await start(central, "w1")
        before = await until_known(central.bus, len(THINGS))
        await start(central, "w2")
        await asyncio.sleep(4)  # the one that stands by has got the state by then
        first.process.kill()
        lost_s = time()
        async with central.bus.subscribe(world_key(SITE, WorldStream.STATUS), QUEUE(100), history=False) as statuses:
            async with asyncio.timeout(PATIENCE_S):
                async for sample in statuses:
                    status = codec.decode(SiteStatus, sample.payload, sample.encoding)
                    if status.worker == "w2" and sum(status.objects.values()) == len(THINGS):
                        break
        assert time() - lost_s < 5  # what is promised
        after = await until_known(central.bus, len(THINGS))
        assert {each.id for each in after.objects} == {each.id for each in before.objects}


async def test_a_worker_that_wins_a_site_and_does_not_serve_it_is_passed_over() -> None:
    robots, idle = Robots(THINGS), WorkerAlive("worldmodel", "idle", weight=MAX_WEIGHT)
    async with fleet_rig() as central, central.bus.announce(str(idle)), robots.looking(central.bus):
        await start(central, "w1")
        await until_known(central.bus, len(THINGS))


async def test_a_monitor_counts_what_is_in_each_zone_also_after_another_worker_took_over() -> None:
    robots, fleet = Robots(THINGS), Fleet("clock")
    near = Zone(name="near", site=SITE, corners=((3, -2), (4, -2), (4, 2), (3, 2)))
    far = Zone(name="far", site=SITE, corners=((4, -2), (6, -2), (6, 2), (4, 2)))
    fleet.world = World([near, far])

    def counts() -> list[dict[str, int]]:
        found = fleet.world.zones(fleet.sites, time_ns())
        return [{name: count for name, count in each.objects.items() if count} for each in found if each.current]

    async with fleet_rig() as central, robots.looking(central.bus):
        watching = asyncio.create_task(watch_fleet(central.bus, fleet))
        first = await start(central, "w1")
        await until(lambda: counts() == [{"box": 1, "pallet": 1}, {"box": 1}])
        robots.things = THINGS[1:]
        await until(lambda: counts() == [{"pallet": 1}, {"box": 1}])
        first.process.terminate()
        await first.process.wait()
        await until(lambda: not counts())
        await start(central, "w2")
        robots.things = THINGS[:2]
        await until(lambda: counts() == [{"box": 1, "pallet": 1}, {}])
        watching.cancel()
        await asyncio.wait([watching])


ZONES_FILE = """
zones:
  - {name: near, site: hall-2, corners: [[3, -2], [4, -2], [4, 2], [3, 2]]}
  - {name: behind, site: hall-2, corners: [[-9, -2], [-5, -2], [-5, 2]]}
"""
RULES_FILE = """
rules:
  - {name: boxes out, when: zone_under, class: box, site: hall-2, zone: near, count: 1}
  - {name: box left, when: leaves, class: box, site: hall-2, zone: near}
  - {name: behind, when: unseen, site: hall-2, zone: behind, than_s: 60}
"""


async def test_rules_on_a_zone_raise_alerts_that_are_in_the_history_and_outlive_a_restart(tmp_path: Path) -> None:
    zones, rules = tmp_path / "zones.yaml", tmp_path / "rules.yaml"
    zones.write_text(ZONES_FILE, encoding="utf-8")
    rules.write_text(RULES_FILE, encoding="utf-8")
    history = f"sqlite:///{tmp_path / 'history.db'}"
    settings = MonitorSettings(zones=zones, rules=rules, history=history, web=False)
    robots = Robots(THINGS)
    async with fleet_rig() as central, robots.looking(central.bus):
        await start(central, "w1")
        async with running(settings, central.bus, Fleet("clock")) as monitor:
            await until(lambda: any(each.objects.get("box") for each in zones_of(monitor)))
            robots.things = THINGS[1:]
            await until(lambda: {alert.rule for alert in monitor.alerts()} == {"boxes out", "box left", "behind"})
            assert {(alert.robot, alert.name) for alert in monitor.alerts()} == {("", "box"), ("", "")}
            under = next(alert for alert in monitor.alerts() if alert.rule == "boxes out")
            assert under.text == "0 box in hall-2/near, under 1"
            await until(lambda: not monitor.history.status.pending)
            stored = await monitor.archive.alerts(HistoryQuery(), 10)
            assert {alert.rule for alert in stored} == {"boxes out", "box left", "behind"}
        async with running(settings, central.bus, Fleet("clock")) as monitor:
            await until(lambda: under.id in {alert.id for alert in monitor.alerts()})
            await until(lambda: any(each.current for each in zones_of(monitor)))
            robots.things = THINGS
            await until(lambda: {alert.rule for alert in monitor.alerts()} == {"behind"})


def zones_of(monitor: Monitor) -> list[ZoneCount]:
    return list(monitor.fleet.world.zones(monitor.fleet.sites, time_ns()))


async def test_a_robot_without_a_map_and_one_that_talks_nonsense_are_named() -> None:
    async with fleet_rig() as central, Robots(THINGS).looking(central.bus, [CAMERAS[0]]):
        await start(central, "w1")
        key = CameraKey("r2", "front").stream(Stream.VIEW)
        seen = view(THINGS, replace(CAMERAS[0], robot="r2"), time())
        far = [msgspec.structs.replace(each, at=(900.0, 0.0, 0.2)) for each in seen.objects]
        wrong = msgspec.structs.replace(seen, objects=far)
        blind = msgspec.structs.replace(
            seen, position=None, unlocated="no map", grid=None, objects=[], unmeasured={"box": 1}
        )
        async with (
            central.bus.publisher(key, QoS.IMAGE, encoding=codec.encoding(CameraView)) as publisher,
            central.bus.subscribe(world_key(SITE, WorldStream.STATUS), QUEUE(100)) as statuses,
            asyncio.timeout(PATIENCE_S),
        ):
            async for sample in statuses:
                status = codec.decode(SiteStatus, sample.payload, sample.encoding)
                said, count = " ".join(status.problems), sum(status.objects.values())
                assert count <= len(THINGS)
                if "r2" in said and "map frame" in said and "farther" in said and count == len(THINGS):
                    break
                for each in (wrong, blind):
                    publisher.put(codec.encode(each))
                    await asyncio.sleep(0.05)
