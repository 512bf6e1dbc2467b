"""The fleet at one moment, and whether alerts are current."""

import msgspec

from schemas.alerts import Alert, AlertState, Severity
from schemas.keys import CameraKey
from services.monitor.fleet import Fleet
from services.monitor.inventory.inventory import Inventory
from services.monitor.liveness import WORKER_ONLINE_NS
from services.monitor.snapshot import FleetView, Snapshot, SnapshotMaker, Workers, known_until_ns
from tests.services.monitor.inventory.seeing import FRONT, S, seen
from tests.services.monitor.web.api.seeing import ODD, fill


def fleet_view(fleet: Fleet, now_ns: int = 0) -> FleetView:
    return FleetView(fleet, Workers(fleet, now_ns), now_ns, 0.0)


def snapshot(fleet: Fleet, now_ns: int) -> Snapshot:
    maker = SnapshotMaker(fleet_view(fleet, now_ns))
    for _ in maker.steps():
        pass
    return maker.snapshot()


def test_an_empty_fleet_is_an_empty_picture() -> None:
    assert snapshot(Fleet("clock"), 5) == Snapshot(5, (), (), ())


def test_who_serves_and_what_was_dropped_is_with_the_camera_and_its_robot() -> None:
    fleet = Fleet("clock")
    fill(fleet)
    heard_ns = fleet.heard_ns["r1"]
    now = snapshot(fleet, heard_ns)
    (first, lost), (camera, _), (worker,) = now.robots, now.cameras, now.workers
    assert camera.dropped == {f"gateway: {ODD}": 4, "detector/w1: late": 2}
    assert first.dropped == {**camera.dropped, "gateway: w": 1}
    assert (camera.served_by, worker.online, len(worker.serves)) == (("detector/w1",), True, 1)
    assert (first.online, first.last_ns >= heard_ns, lost.online, lost.last_ns, lost.gateway) == (
        True,
        True,
        False,
        0,
        None,
    )


def test_a_worker_that_says_nothing_serves_nobody() -> None:
    fleet = Fleet("clock")
    fill(fleet)
    heard_ns = fleet.worker_heard_ns["detector", "w1"]
    assert snapshot(fleet, heard_ns + WORKER_ONLINE_NS).workers[0].online
    later = snapshot(fleet, heard_ns + WORKER_ONLINE_NS + 1)
    assert (later.workers[0].online, later.workers[0].serves, later.cameras[0].served_by) == (False, (), ())


def test_a_robot_that_is_painted_alone_is_as_it_is_in_the_picture() -> None:
    fleet = Fleet("clock")
    fill(fleet)
    now_ns = fleet.heard_ns["r1"]
    whole, some = snapshot(fleet, now_ns), fleet_view(fleet, now_ns)
    assert tuple(some.robot(name) for name in some.robots) == whole.robots
    assert tuple(some.camera(key) for key in some.cameras) == whole.cameras
    assert some.drops("r1", some.cameras_of("r1")) == sum(whole.robots[0].dropped.values()) == 7


def test_every_robot_is_there_once_by_name_with_its_own_cameras() -> None:
    fleet = Fleet("clock")
    for key in (CameraKey("r2", "rear"), CameraKey("r10", "front"), CameraKey("r2", "front")):
        fleet.camera_presence(key, alive=True)
    fleet.robot_presence("r1", alive=True)
    fleet.robot_presence("r2", alive=True)
    some = fleet_view(fleet)
    assert some.robots == ("r1", "r10", "r2")
    assert [[key.camera for key in some.cameras_of(name)] for name in ("r1", "r10", "r2", "r3")] == [
        [],
        ["front"],
        ["front", "rear"],
        [],
    ]


def test_a_robot_of_before_a_restart_was_seen_last_when_it_was_there_until_it_says_something() -> None:
    fleet = Fleet("clock")
    fleet.inventory.recall({("r1", ""): 5, ("r2", ""): 7}, 0)
    fill(fleet)
    painted = {robot.name: robot for robot in snapshot(fleet, 9).robots}
    assert (painted["r2"].online, painted["r2"].last_ns) == (False, 7)
    assert painted["r1"].last_ns >= fleet.heard_ns["r1"]
    fleet = Fleet("clock")
    fleet.inventory.recall({("r1", ""): 5}, 6)
    assert [(robot.name, robot.online, robot.last_ns) for robot in snapshot(fleet, 9).robots] == [("r1", False, 5)]


def test_workers_of_a_service_are_those_that_are_there() -> None:
    fleet = Fleet("clock")
    fill(fleet)
    heard_ns = fleet.worker_heard_ns["detector", "w1"]
    assert [each.worker for each in Workers(fleet, heard_ns).of("detector")] == ["w1"]
    assert Workers(fleet, heard_ns).of("cloud") == Workers(fleet, heard_ns + WORKER_ONLINE_NS + 1).of("detector") == []


BOXES = Alert(
    id="1",
    rule="boxes",
    severity=Severity.INFO,
    state=AlertState.RAISED,
    robot="r1",
    camera="front",
    name="box",
    text="3 box in view of r1/front, over 1",
    raised_ns=101 * S,
    changed_ns=101 * S,
)


def seeing() -> Inventory:
    """Return an inventory whose one camera spoke last at 101 s."""
    inventory = Inventory()
    inventory.robot_presence("r1", alive=True)
    inventory.camera_presence(FRONT, alive=True)
    for second in (100, 101):
        inventory.see(seen(second, {"box": 3}), second * S)
    return inventory


def test_what_an_alert_says_is_known_while_its_camera_speaks() -> None:
    assert known_until_ns(BOXES, seeing(), 103 * S) is None


def test_it_is_not_known_once_the_camera_is_silent_or_the_robot_gone() -> None:
    inventory = seeing()
    assert known_until_ns(BOXES, inventory, 105 * S) == 101 * S
    inventory.robot_presence("r1", alive=False)
    assert known_until_ns(BOXES, inventory, 102 * S) == 101 * S
    inventory.robot_presence("r1", alive=True)
    assert known_until_ns(BOXES, inventory, 102 * S) is None


def test_what_was_raised_before_a_restart_was_known_then() -> None:
    earlier = msgspec.structs.replace(BOXES, raised_ns=7 * S)
    assert known_until_ns(earlier, Inventory(), 100 * S) == 7 * S
    inventory = Inventory()
    inventory.camera_presence(FRONT, alive=True)
    assert known_until_ns(earlier, inventory, 100 * S) == 7 * S


def test_silence_is_known_and_so_is_that_an_alert_is_over() -> None:
    silent = msgspec.structs.replace(BOXES, name="", text="r1/front is silent")
    assert known_until_ns(silent, seeing(), 200 * S) is None
    assert known_until_ns(msgspec.structs.replace(silent, camera=""), Inventory(), 200 * S) is None
    resolved = msgspec.structs.replace(BOXES, state=AlertState.RESOLVED)
    assert known_until_ns(resolved, Inventory(), 200 * S) is None
