import asyncio
import io
import itertools
import time
from collections.abc import AsyncIterator

import msgspec
import pytest
from rich.console import Console

from bus import Bus, QoS
from bus.fake import FakeNetwork
from schemas import codec, keys, worker_keys
from schemas.codec import Message
from schemas.detections import ClassCount, ClassList
from schemas.inventory import InventoryAnswer
from schemas.keys import CameraKey, Stream
from schemas.status import GatewayStatus, WorkerStatus
from schemas.worker_keys import WorldStream, world_key
from services.monitor.display import MAX_LINES, show
from services.monitor.fleet import Fleet
from services.monitor.formats import MAX_SHOWN
from services.monitor.process import watch_fleet
from tests.schemas.frames import header
from tests.schemas.results import distances, known
from tests.services.monitor.inventory.seeing import going_on
from tests.services.monitor.world.test_site_status import status as site_status
from tests.waiting import until

FRONT = CameraKey("r1", "front")
SEEN = ClassList(header=header(), classes=[ClassCount("box", 2, 0.9)], model="m", worker="w")
GATEWAY = GatewayStatus(robot="r1", boot_id="b", clock_id="clock", sent_ns=1)
HALL = site_status("hall", box=2)
STATUSES = (keys.gateway_status("r1"), worker_keys.worker_status("detector", "w1"))
WORKER = WorkerStatus(service="detector", worker="w1", model="m", sent_ns=1)


@pytest.fixture
def fleet() -> Fleet:
    return Fleet("clock")


@pytest.fixture
async def bus(fleet: Fleet) -> AsyncIterator[Bus]:
    """The rest of the fleet's bus, watched by a monitor."""
    network = FakeNetwork()
    async with network.open_bus() as theirs, network.open_bus() as ours, asyncio.TaskGroup() as group:
        watching = group.create_task(watch_fleet(ours, fleet))
        for key in (*map(FRONT.stream, (Stream.DISTANCES, Stream.CLASSES, Stream.OPINION)), *STATUSES):
            async with theirs.publisher(key, QoS.RESULT, encoding="") as publisher:
                await until(lambda publisher=publisher: publisher.wanted)  # type: ignore[misc]
        yield theirs
        watching.cancel()


async def publish(bus: Bus, key: str, message: Message) -> None:
    await send(bus, key, codec.encode(message), codec.encoding(type(message)))


async def send(bus: Bus, key: str, payload: bytes, encoding: str) -> None:
    async with bus.publisher(key, QoS.RESULT, encoding=encoding) as publisher:
        publisher.put(payload)


async def test_presence_and_class_lists_fill_the_fleet(bus: Bus, fleet: Fleet) -> None:
    async with bus.announce(keys.robot_alive("r1")), bus.announce(FRONT.alive(Stream.COLOR)):
        for seq in (0, 1):
            await publish(bus, FRONT.stream(Stream.CLASSES), msgspec.structs.replace(SEEN, header=header(seq=seq)))
        await until(lambda: fleet.lists_per_robot()["r1"] == 2)
        (row,) = fleet.rows(0)
        assert (row.key, row.online, row.classes) == (FRONT, True, (ClassCount("box", 2, 0.9),))
    await until(lambda: not next(fleet.rows(0)).online)


async def test_distances_reach_the_inventory_and_programs_may_ask(bus: Bus, fleet: Fleet) -> None:
    later = msgspec.structs.replace(SEEN, header=header(seq=1))
    await publish(bus, FRONT.stream(Stream.CLASSES), SEEN)
    await publish(bus, FRONT.stream(Stream.CLASSES), later)
    await until(lambda: going_on(fleet.inventory))
    await publish(bus, FRONT.stream(Stream.DISTANCES), distances(known("box", 2.0)))
    await until(lambda: going_on(fleet.inventory)[0].nearest_m)
    reply = await bus.request(keys.INVENTORY, timeout_s=5)
    (sighting,) = codec.decode(InventoryAnswer, reply.payload, reply.encoding).sightings
    assert (sighting.name, sighting.count, sighting.nearest_m, sighting.available) == ("box", 2, 2.125, False)


async def test_second_opinions_reach_the_inventory_and_count_as_nothing_else(bus: Bus, fleet: Fleet) -> None:
    async with bus.announce(FRONT.alive(Stream.COLOR)):
        await until(lambda: fleet.cameras)
    other = msgspec.structs.replace(SEEN, classes=[ClassCount("box", 3, 0.9)], model="new")
    for seq in (0, 1):
        await publish(bus, FRONT.stream(Stream.OPINION), msgspec.structs.replace(other, header=header(seq=seq)))
    view = fleet.inventory.camera(FRONT)
    assert view is not None
    await until(lambda: "new" in view.opinions and view.opinions["new"].lists == 2)
    assert (fleet.class_lists, next(fleet.rows(0)).classes, going_on(fleet.inventory)) == (0, None, [])
    for seq in (0, 1):
        await publish(bus, FRONT.stream(Stream.CLASSES), msgspec.structs.replace(SEEN, header=header(seq=seq)))
    await until(lambda: view.disagreements(0))
    assert view.disagreements(0) == {"box": (2, 3)}
    assert [each.count for each in going_on(fleet.inventory)] == [2]


async def test_statuses_are_kept(bus: Bus, fleet: Fleet) -> None:
    await publish(bus, keys.gateway_status("r1"), GATEWAY)
    await publish(bus, worker_keys.worker_status("detector", "w1"), WORKER)
    await publish(bus, world_key("hall", WorldStream.STATUS), HALL)
    await until(lambda: fleet.gateways and fleet.workers and fleet.sites.every())
    assert [known.status for known in fleet.sites.every()] == [HALL]
    assert fleet.gateways == {"r1": GATEWAY}
    assert fleet.workers == {("detector", "w1"): WORKER}


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("fleet/r2/front/classes", SEEN),
        ("fleet/<b>r1/front/classes", SEEN),
        ("fleet/r1/rear/classes", SEEN),
        ("fleet/r1/rear/opinion", SEEN),
        ("fleet/r2/status", GATEWAY),
        ("workers/detector/w2/status", WORKER),
        ("workers/distance/w1/status", WORKER),
        ("world/other/status", HALL),
    ],
)
async def test_a_message_that_is_not_its_keys_is_left_out(bus: Bus, fleet: Fleet, key: str, message: Message) -> None:
    await publish(bus, key, message)
    await publish(bus, FRONT.stream(Stream.CLASSES), SEEN)
    await until(lambda: fleet.lists_per_robot()["r1"] and fleet.left_out)
    assert fleet.lists_per_robot() == {"r1": 1}
    assert (fleet.gateways, fleet.workers, fleet.sites.every()) == ({}, {}, [])
    assert fleet.left_out == {"malformed messages": 1}


@pytest.mark.parametrize(
    "key",
    [FRONT.stream(Stream.CLASSES), FRONT.stream(Stream.OPINION), "fleet/r1/status", "workers/detector/w1/status"],
)
async def test_garbage_is_left_out_and_harms_no_other(bus: Bus, fleet: Fleet, key: str) -> None:
    for encoding in ("", codec.encoding(ClassList)):
        await send(bus, key, b"\xc1garbage", encoding)
    await publish(bus, FRONT.stream(Stream.CLASSES), SEEN)
    await until(lambda: fleet.lists_per_robot()["r1"] and fleet.left_out.total() == 2)
    assert fleet.left_out == {"malformed messages": 2}


async def test_a_token_under_an_odd_key_is_left_out(bus: Bus, fleet: Fleet) -> None:
    async with bus.announce("fleet/r1/status/color/alive"), bus.announce(FRONT.alive(Stream.COLOR)):
        await until(lambda: [row.key for row in fleet.rows(0)] == [FRONT])


async def test_without_a_terminal_changes_are_printed_once(fleet: Fleet) -> None:
    console = Console(file=io.StringIO(), force_terminal=False)
    fleet.camera_presence(FRONT, alive=True)
    showing = asyncio.create_task(show(fleet, console, 0.01, note="listening"))
    await asyncio.sleep(0.1)
    for seq in (0, 1):
        fleet.see(msgspec.structs.replace(SEEN, header=header(seq=seq)), 0, 0)
    fleet.robot_presence("r2", alive=True)
    fleet.gateway_status(GatewayStatus(robot="r2", boot_id="b", clock_id="c", sent_ns=0, waiting_for="a master"), 0)
    await asyncio.sleep(0.1)
    showing.cancel()
    await asyncio.wait([showing])
    assert isinstance(console.file, io.StringIO)
    note, first, second, third = console.file.getvalue().splitlines()
    assert note == "listening"
    assert first == "r1/front: offline, waiting for class lists, age -, 0.0/s"
    assert second.startswith("r1/front: offline, 2 box, age > ")
    assert third == "r2 waits for a master"


async def test_without_a_terminal_it_is_said_that_a_camera_fell_silent_and_that_it_speaks_again(fleet: Fleet) -> None:
    numbers = itertools.count(1)
    console = Console(file=io.StringIO(), force_terminal=False)
    assert isinstance(console.file, io.StringIO)
    written = console.file
    fleet.robot_presence("r1", alive=True)
    fleet.camera_presence(FRONT, alive=True)

    def see() -> None:
        seen = msgspec.structs.replace(SEEN, header=header(seq=next(numbers)))
        fleet.see(seen, time.monotonic(), time.time_ns())

    def spoken() -> str:
        see()
        return states()[-1]

    def states() -> list[str]:
        return [line.partition(",")[0] for line in written.getvalue().splitlines()[1:]]

    showing = asyncio.create_task(show(fleet, console, 0.01, note="listening"))
    see()
    see()
    await until(states)
    await until(lambda: states()[-1] == "r1/front: silent")
    await until(lambda: spoken() == "r1/front: online")
    showing.cancel()
    await asyncio.wait([showing])
    assert states() == ["r1/front: online", "r1/front: silent", "r1/front: online"]


async def test_without_a_terminal_each_robot_that_waits_is_named_however_many_wait_already(fleet: Fleet) -> None:
    console = Console(file=io.StringIO(), force_terminal=False)
    assert isinstance(console.file, io.StringIO)
    written = console.file

    def wait_for(robot: str, what: str) -> None:
        fleet.robot_presence(robot, alive=True)
        fleet.gateway_status(msgspec.structs.replace(GATEWAY, robot=robot, waiting_for=what), time.time_ns())

    some = [f"r{number}" for number in range(MAX_SHOWN)]
    for robot in some:
        wait_for(robot, "its master")
    showing = asyncio.create_task(show(fleet, console, 0.01, note="listening"))
    await until(lambda: f"{some[-1]} waits" in written.getvalue())
    for robot in ("s1", "s2"):
        wait_for(robot, "its camera")
        await until(lambda robot=robot: f"{robot} waits" in written.getvalue())  # type: ignore[misc]
    showing.cancel()
    await asyncio.wait([showing])
    assert written.getvalue().splitlines()[1:] == [
        *(f"{robot} waits for its master" for robot in some),
        "s1 waits for its camera",
        "s2 waits for its camera",
    ]


async def test_of_many_changes_at_once_some_are_printed_and_the_rest_counted(fleet: Fleet) -> None:
    console = Console(file=io.StringIO(), force_terminal=False)
    for number in range(MAX_LINES + 2):
        fleet.camera_presence(CameraKey(f"r{number}", "front"), alive=True)
    assert isinstance(console.file, io.StringIO)
    written = console.file
    showing = asyncio.create_task(show(fleet, console, 60, note="listening"))
    await until(lambda: "more cameras" in written.getvalue())
    showing.cancel()
    await asyncio.wait([showing])
    _, *cameras, rest = written.getvalue().splitlines()
    assert (len(cameras), rest) == (MAX_LINES, "and 2 more cameras changed: 2 offline")


async def test_on_a_terminal_the_table_is_drawn(fleet: Fleet) -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    fleet.camera_presence(FRONT, alive=True)
    fleet.robot_presence("r2", alive=True)
    fleet.gateway_status(GatewayStatus(robot="r2", boot_id="b", clock_id="c", sent_ns=0, waiting_for="a master"), 0)
    showing = asyncio.create_task(show(fleet, console, 0.01, note="listening"))
    await asyncio.sleep(0.05)
    showing.cancel()
    await asyncio.wait([showing])
    assert isinstance(console.file, io.StringIO)
    assert "waiting for class lists" in console.file.getvalue()
    assert "listening" in console.file.getvalue()
    assert "r2 waits for a master" in console.file.getvalue()
