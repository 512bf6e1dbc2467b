"""From what a camera sees to what its robot does: rules of a real monitor, a real gateway and real rospy nodes."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest

from bus import QoS
from schemas import codec
from schemas.detections import ClassList
from schemas.keys import Stream
from tests.integration.fleet import FleetRig, fleet_rig
from tests.integration.peers.ros import RosEnvironment
from tests.integration.peers.rospy_scripts import LISTENER
from tests.services.monitor.inventory.seeing import FRONT, seen

RULES = """
rules:
  - name: a box to pick up
    when: over
    class: box
    count: 0
    action: {name: pick_up, payload: "{class} at {robot}/{camera}"}
"""


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


def now(said: ClassList) -> ClassList:
    header = msgspec.structs.replace(said.header, received_ns=time.time_ns())
    return msgspec.structs.replace(said, header=header)


@asynccontextmanager
async def seeing_a_box(rig: FleetRig) -> AsyncIterator[None]:
    """Publish class lists of the front camera."""

    async def publish() -> None:
        key, encoding = FRONT.stream(Stream.CLASSES), codec.encoding(ClassList)
        async with (
            rig.bus.announce(FRONT.alive(Stream.COLOR)),
            rig.bus.publisher(key, QoS.RESULT, encoding=encoding) as publisher,
        ):
            seq = 0
            while True:
                seq += 1
                publisher.put(codec.encode(now(seen(seq, {"box": 1}))))
                await asyncio.sleep(0.1)

    running = asyncio.create_task(publish())
    try:
        yield
    finally:
        running.cancel()
        await asyncio.wait([running])


@pytest.mark.timeout(120)
async def test_a_robot_picks_up_the_box_that_its_camera_sees(
    ros: RosEnvironment, rig: FleetRig, tmp_path: Path
) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text(RULES, encoding="utf-8")
    planner = await ros.script(LISTENER, "planner", "/planner/pick_up")
    people = await ros.script(LISTENER, "people", "/ultralytics/alerts")
    await planner.until_output("listener up")
    await people.until_output("listener up")
    await rig.gateway("r1", ros.master_uri, {}, "--actions", "pick_up=/planner/pick_up")
    await rig.start("monitor", "--mode", "client", "--no-web", "--history", "none", "--rules", str(rules))
    async with seeing_a_box(rig):
        await planner.until_output("heard box at r1/front")
        await people.until_output('"text":"1 box in view of r1/front, over 0"')
