"""What a real monitor that was cut off, or came late, makes of class lists published meanwhile."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest

from bus import Publisher, QoS, Reply, Request
from bus.clocks import clock_id
from schemas import codec, keys
from schemas.detections import KEPT_LISTS, ClassList
from schemas.keys import Stream
from schemas.status import ClockReading, GatewayStatus
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig
from tests.integration.monitor.test_history import PALLETS, QUICK, pallets, rows
from tests.integration.monitor.watching import camera, inventory, taken
from tests.integration.network.severed import severable
from tests.services.monitor.inventory.seeing import FRONT, seen

CUT_S = 2.5
NS = 1_000_000_000
AHEAD_NS = -1_000 * NS
BEFORE_S = 3.0
MEANWHILE_S = 1.5
HZ = 10
ABOUT_NS = NS // 2


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def test_no_list_published_while_the_monitor_was_cut_off_is_lost(rig: FleetRig, tmp_path: Path) -> None:
    file = tmp_path / "history.db"
    async with severable(int(rig.endpoint.rpartition(":")[2])) as link, camera(rig) as front:
        await rig.at(link.port).start(
            "monitor", "--mode", "client", "--no-web", "--history", f"sqlite:///{file}", *QUICK
        )
        await inventory(rig)
        await front.watch(0.5)
        link.sever()
        during = front.sent
        await front.watch(CUT_S, "pallet")
        missed = front.sent - during
        link.mend()
        await front.watch(0.2)
        answer = await taken(rig, front.sent)
        assert (answer.class_lists, answer.left_out) == (front.sent, {})
        async with asyncio.timeout(PATIENCE_S):
            while len(rows(file, PALLETS)) < -(-missed // 5):  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.1)


class Robot:
    """What a robot and its one camera say of themselves. ahead_ns: its clock less ours; 0 where they are one."""

    def __init__(self, ahead_ns: int, lists: Publisher, statuses: Publisher) -> None:
        self._ahead_ns = ahead_ns
        self._clock_id = "another machine" if ahead_ns else clock_id()
        self._lists = lists
        self._statuses = statuses
        self._seq = 0

    async def see(self, seconds: float, **counts: int) -> None:
        """Publish class lists, and statuses."""
        for _ in range(round(seconds * HZ)):
            self._seq += 1
            made = seen(self._seq, counts)
            header = msgspec.structs.replace(made.header, received_ns=time.time_ns() + self._ahead_ns)
            self._lists.put(codec.encode(msgspec.structs.replace(made, header=header)))
            if self._seq % HZ == 0:
                status = GatewayStatus(
                    robot=FRONT.robot, boot_id="boot", clock_id=self._clock_id, sent_ns=header.received_ns
                )
                self._statuses.put(codec.encode(status))
            await asyncio.sleep(1 / HZ)

    async def tell(self, _: Request) -> Reply:
        """Say what its clock shows."""
        now_ns = time.time_ns() + self._ahead_ns
        reading = ClockReading(
            robot=FRONT.robot, boot_id="boot", clock_id=self._clock_id, received_ns=now_ns, sent_ns=now_ns
        )
        return Reply(codec.encode(reading), codec.encoding(ClockReading))


@asynccontextmanager
async def robot(rig: FleetRig, ahead_ns: int) -> AsyncIterator[Robot]:
    """Have a robot be there."""
    lists, statuses = FRONT.stream(Stream.CLASSES), keys.gateway_status(FRONT.robot)
    async with (
        rig.bus.publisher(lists, QoS.RESULT, encoding=codec.encoding(ClassList), kept=KEPT_LISTS) as out,
        rig.bus.publisher(statuses, QoS.STATUS, encoding=codec.encoding(GatewayStatus)) as status,
    ):
        made = Robot(ahead_ns, out, status)
        async with (
            rig.bus.serve(keys.robot_clock(FRONT.robot), made.tell),
            rig.bus.announce(keys.robot_alive(FRONT.robot)),
            rig.bus.announce(FRONT.alive(Stream.COLOR)),
        ):
            yield made


@pytest.mark.parametrize(
    ("begins_again", "ahead_ns"),
    [(False, 0), (False, AHEAD_NS), (True, 0), (True, AHEAD_NS)],
    ids=["cut off", "cut off from another machine", "begun again", "begun again on another machine"],
)
async def test_what_was_in_view_meanwhile_is_filed_under_when_it_was(
    rig: FleetRig, tmp_path: Path, *, begins_again: bool, ahead_ns: int
) -> None:
    file = tmp_path / "history.db"
    async with severable(int(rig.endpoint.rpartition(":")[2])) as link, robot(rig, ahead_ns) as there:
        where = ("monitor", "--mode", "client", "--no-web", "--history", f"sqlite:///{file}")
        monitor = await rig.at(link.port).start(*where)
        await inventory(rig)
        await there.see(BEFORE_S, box=1)
        link.sever()
        if begins_again:
            monitor.process.kill()
            await monitor.process.wait()
        await there.see(MEANWHILE_S, box=1)
        came_ns = time.time_ns()
        await there.see(MEANWHILE_S, box=1, pallet=2)
        went_ns = time.time_ns()
        await there.see(MEANWHILE_S, box=1)
        link.mend()
        if begins_again:
            await rig.at(link.port).start(*where)
        going_on = asyncio.create_task(there.see(PATIENCE_S, box=1))
        ((since_ns, until_ns),) = await pallets(file, 0)
        going_on.cancel()
        assert since_ns == pytest.approx(came_ns, abs=ABOUT_NS)
        assert until_ns == pytest.approx(went_ns, abs=ABOUT_NS)


async def test_a_monitor_that_comes_late_or_again_takes_in_what_publishers_kept(rig: FleetRig) -> None:
    where = ("--mode", "client", "--no-web", "--history", "none", *QUICK)
    async with camera(rig) as front:
        await front.watch(0.3, "pallet")
        first = await rig.start("monitor", *where)
        assert [each.name for each in (await taken(rig, front.sent)).sightings] == ["box", "pallet"]
        first.process.kill()
        await first.process.wait()
        for _ in range(KEPT_LISTS + 5):
            front.put("forklift")
            await asyncio.sleep(0.005)
        await rig.start("monitor", *where)
        answer = await taken(rig, KEPT_LISTS)
        assert (answer.class_lists, [each.name for each in answer.sightings]) == (KEPT_LISTS, ["forklift"])
