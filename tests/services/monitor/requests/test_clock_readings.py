"""Readings of robots' clocks."""

import asyncio
import time

import pytest

from bus import RefusedError, Reply, Request
from bus.fake import FakeNetwork
from schemas import codec, keys
from schemas.status import ClockReading, GatewayStatus
from services.monitor.fleet import Fleet
from services.monitor.requests.clock_readings import measure_clocks
from tests.waiting import until

AHEAD_NS = 3_600_000_000_000


def reading(robot: str) -> ClockReading:
    theirs_ns = time.time_ns() + AHEAD_NS
    return ClockReading(robot=robot, boot_id="b", clock_id="theirs", received_ns=theirs_ns, sent_ns=theirs_ns)


def fleet_with_clocks(*robots: str) -> Fleet:
    fleet = Fleet("ours")
    for robot in robots:
        fleet.robot_presence(robot, alive=True)
        fleet.gateway_status(GatewayStatus(robot=robot, boot_id="b", clock_id="theirs", sent_ns=0), 0)
    return fleet


async def test_clocks_of_robots_are_measured_and_one_that_does_not_tell_harms_no_other() -> None:
    fleet = fleet_with_clocks("babbles", "good", "missing", "refuses")

    async def good(_: Request) -> Reply:
        return Reply(codec.encode(reading("good")), codec.encoding(ClockReading))

    async def babble(_: Request) -> Reply:
        return Reply(b"tick")

    async def refuse(_: Request) -> Reply:
        raise RefusedError("no")

    async with (
        FakeNetwork().open_bus() as bus,
        bus.serve(keys.robot_clock("good"), good),
        bus.serve(keys.robot_clock("babbles"), babble),
        bus.serve(keys.robot_clock("refuses"), refuse),
    ):
        measuring = asyncio.create_task(measure_clocks(bus, fleet))
        await until(lambda: fleet.clocks.theirs_ns("good", "theirs", time.time_ns()) is not None)
        now_ns = time.time_ns()
        theirs_ns = fleet.clocks.theirs_ns("good", "theirs", now_ns)
        assert theirs_ns is not None
        assert theirs_ns - now_ns == pytest.approx(AHEAD_NS, abs=100_000_000)
        for robot in ("babbles", "missing", "refuses"):
            assert fleet.clocks.theirs_ns(robot, "theirs", now_ns) is None
        assert not measuring.done()
        measuring.cancel()
        await asyncio.wait([measuring])
