"""What a real monitor process makes of what it should never be given."""

import asyncio
import resource
import time
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path

import msgspec
import pytest

from bus import QoS, Reply, Request
from schemas import codec, keys
from schemas.alerts import Alert, AlertState
from schemas.detections import ClassList
from schemas.inventory import InventoryAnswer
from schemas.keys import Stream
from schemas.status import ClockReading, GatewayStatus
from tests.integration.fleet import PATIENCE_S, FleetRig, fleet_rig, receive
from tests.integration.monitor.test_history import QUICK
from tests.integration.monitor.watching import always_seeing, camera, inventory, taken, told
from tests.services.monitor.inventory.seeing import FRONT, S, seen

HTML = "<img src=x onerror=alert(1)>"
HOUR_NS = 3_600 * S
CLASSES = codec.encoding(ClassList)


@pytest.fixture
async def rig() -> AsyncIterator[FleetRig]:
    async with fleet_rig() as made:
        yield made


async def send(rig: FleetRig, key: str, payload: bytes) -> None:
    async with rig.bus.publisher(key, QoS.RESULT, encoding=CLASSES) as publisher:
        publisher.put(payload)


def has_left_out(number: int, answer: InventoryAnswer) -> bool:
    return answer.left_out.get("malformed messages", 0) == number


async def test_messages_that_cannot_be_taken_are_counted_and_harm_no_other(rig: FleetRig) -> None:
    started = await rig.start("monitor", "--mode", "client", "--no-web", "--history", "none", *QUICK)
    await inventory(rig)
    good = codec.encode(seen(1, {"box": 1}))
    huge = msgspec.structs.replace(seen(1, {}), spans={f"{number:032}": number for number in range(9_000)})
    assert len(codec.encode(huge)) > codec.MAX_BYTES[ClassList]
    for number, (key, payload) in enumerate(
        [
            (FRONT.stream(Stream.CLASSES), b"\xc1garbage"),
            (FRONT.stream(Stream.CLASSES), codec.encode(huge)),
            (FRONT.stream(Stream.CLASSES), good[:-3]),
            (f"fleet/{HTML}/front/classes", good),
            (f"fleet/r1/{HTML}/classes", good),
        ],
        1,
    ):
        await send(rig, key, payload)
        assert not (await told(rig, partial(has_left_out, number))).sightings
    async with rig.bus.announce(f"fleet/{HTML}/alive"), rig.bus.announce(f"fleet/{HTML}/front/color/alive"):
        await told(rig, partial(has_left_out, 7))
    async with camera(rig) as front:
        front.put("box", "\x1b[2J\nr1/front: online, nothing")
        answer = await taken(rig, 1)
        assert [each.robot for each in answer.sightings] == ["r1", "r1"]
        async with asyncio.timeout(PATIENCE_S):
            while not any("1 box" in line for line in started.output):  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.05)
    assert not [line for line in started.output if "\x1b" in line or HTML in line or line.endswith("online, nothing")]


async def test_a_robot_whose_clock_is_an_hour_ahead_is_seen_now(rig: FleetRig) -> None:
    asked = asyncio.Event()

    async def tell(request: Request) -> Reply:
        asked.set()
        theirs_ns = request.received_ns + HOUR_NS
        reading = ClockReading(
            robot="r1", boot_id="boot", clock_id="its own", received_ns=theirs_ns, sent_ns=time.time_ns() + HOUR_NS
        )
        return Reply(codec.encode(reading), codec.encoding(ClockReading))

    status = GatewayStatus(robot="r1", boot_id="boot", clock_id="its own", sent_ns=time.time_ns() + HOUR_NS)
    await rig.start("monitor", "--mode", "client", "--no-web", "--history", "none", *QUICK)
    await inventory(rig)
    async with (
        rig.bus.serve(keys.robot_clock("r1"), tell),
        rig.bus.announce(keys.robot_alive("r1")),
        rig.bus.announce(FRONT.alive(Stream.COLOR)),
        rig.bus.publisher(keys.gateway_status("r1"), QoS.STATUS, encoding=codec.encoding(GatewayStatus)) as out,
        rig.bus.publisher(FRONT.stream(Stream.CLASSES), QoS.RESULT, encoding=CLASSES) as lists,
    ):
        out.put(codec.encode(status))
        for seq in range(4):
            header = msgspec.structs.replace(seen(seq, {}).header, received_ns=time.time_ns() + HOUR_NS)
            lists.put(codec.encode(msgspec.structs.replace(seen(seq, {"box": 1}), header=header)))
            (box,) = (await taken(rig, seq + 1)).sightings
            assert abs(time.time_ns() - box.last_ns) < HOUR_NS / 60
            await asyncio.wait_for(asked.wait(), PATIENCE_S)


async def test_a_mistake_in_the_rule_file_is_told_and_leaves_the_rules_as_they_were(
    rig: FleetRig, tmp_path: Path
) -> None:
    rules = tmp_path / "rules.yaml"
    right = "rules:\n  - {name: boxes, when: over, class: box, count: 0}\n"
    rules.write_text(right, encoding="utf-8")
    await rig.start("monitor", "--mode", "client", "--no-web", "--history", "none", "--rules", str(rules), *QUICK)
    async with rig.subscribed("fleet/r1/alerts") as alerts, always_seeing(rig) as front:
        await inventory(rig)
        rules.write_text(f"{right}  - {{name: pallets, when: over, class: pallet, count: many}}\n", encoding="utf-8")
        (problem,) = (await told(rig, lambda answer: answer.problems)).problems
        assert f"{rules}: line 3: rule 2: count: Input should be a valid integer" in problem
        front.names = ("box", "pallet")
        alert = await receive(alerts, Alert)
        assert (alert.rule, alert.state) == ("boxes", AlertState.RAISED)
        rules.write_text(right, encoding="utf-8")
        await told(rig, lambda answer: not answer.problems)


async def test_monitoring_goes_on_when_the_disk_is_full(rig: FleetRig, tmp_path: Path) -> None:
    file = tmp_path / "history.db"
    started = await rig.start("monitor", "--mode", "client", "--no-web", "--history", f"sqlite:///{file}", *QUICK)
    async with always_seeing(rig, "box") as front:
        await told(rig, lambda answer: answer.sightings and not answer.problems)
        limits = resource.prlimit(started.process.pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))
        (problem,) = (await told(rig, lambda answer: answer.problems)).problems
        assert problem.startswith("history is not being kept: ")
        front.names = ("box", "pallet")
        await told(rig, lambda answer: len(answer.sightings) == 2)
        resource.prlimit(started.process.pid, resource.RLIMIT_FSIZE, limits)
        await told(rig, lambda answer: not answer.problems)
    assert any(line == problem for line in started.output)
