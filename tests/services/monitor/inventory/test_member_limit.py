"""Invented names: the inventory stays bounded, and those who are there keep, or get, their place."""

import pytest

from schemas.keys import MOST_CAMERAS, CameraKey
from services.monitor import fleet as fleet_module
from services.monitor.fleet import Fleet
from services.monitor.inventory import inventory as inventory_module
from services.monitor.inventory import member_limit as room_module
from services.monitor.inventory import view as view_module
from services.monitor.inventory.availability import AvailabilityTracker
from services.monitor.inventory.inventory import Inventory
from services.monitor.inventory.member_limit import (
    CLAIMED_PART,
    MAX_MEMBERS,
    SETTLED_NS,
    SHOWN_NS,
    InventoryFullError,
)
from services.monitor.inventory.sighting import ChangeKind, Sighting
from services.monitor.inventory.view import MAX_CLASSES, MOST_LISTED, bytes_of
from tests.services.monitor.inventory.seeing import FRONT, S, seen
from tests.services.monitor.sightings import CLOCK, status

MOST = 2_000
INVENTED = MOST + 500
NEW = CameraKey("new", "front")


@pytest.fixture(autouse=True)
def _smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (fleet_module, inventory_module, room_module):
        monkeypatch.setattr(module, "MAX_MEMBERS", MOST)


def there(inventory: Inventory, key: CameraKey, *, alive: bool = True) -> None:
    inventory.robot_presence(key.robot, alive=alive)
    inventory.camera_presence(key, alive=alive)


def invented(number: int) -> CameraKey:
    return CameraKey(f"x{number}", "front")


def flood(fleet: Fleet, how: str) -> None:
    """Invent names by class lists, by tokens that go again, or by the statuses of gateways."""
    for number in range(INVENTED):
        key = invented(number)
        if how == "lists":
            fleet.see(seen(1, {"box": 1}, key=key), number, number + 2 * S)
        elif how == "tokens":
            for alive in (True, False):
                fleet.robot_presence(key.robot, alive=alive)
                fleet.camera_presence(key, alive=alive)
        else:
            fleet.gateway_status(status(robot=key.robot), number + 2 * S)


def settle(inventory: Inventory) -> None:
    """Have all cameras had their time to announce themselves."""
    inventory.tick(S - SETTLED_NS)
    inventory.tick(S)


@pytest.mark.parametrize("how", ["lists", "tokens", "statuses"])
def test_invented_names_take_nobodys_place_and_leave_room_for_the_next_robot(how: str) -> None:
    fleet = Fleet(CLOCK)
    inventory = fleet.inventory
    there(inventory, FRONT)
    fleet.gateway_status(status(robot="r1"), S)
    fleet.see(seen(1, {"box": 1}), 0, S)
    flood(fleet, how)
    assert inventory.online(FRONT)
    assert fleet.see(seen(2, {"box": 1}), 1, 2 * S) is not None
    assert inventory.is_available(inventory.cameras_after(0)[0], 2 * S)
    assert "r1" in fleet.gateways
    fleet.robot_presence(NEW.robot, alive=True)
    fleet.camera_presence(NEW, alive=True)
    fleet.gateway_status(status(robot=NEW.robot), 3 * S)
    fleet.see(seen(1, {"box": 1}, key=NEW), 2, 3 * S)
    assert inventory.online(NEW)
    assert {"r1", "new"} <= fleet.gateways.keys()
    assert len(fleet.gateways) <= MOST
    assert len(list(fleet.rows(0))) == len(inventory.in_order()) == len(inventory.cameras()) <= MOST
    assert fleet.lists_per_robot().total() <= MOST + 2
    assert bool(inventory.member_limit.made) == (how != "statuses")


def test_as_many_as_there_may_be_are_followed_and_500_more_make_room_among_themselves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(room_module, "MAX_MEMBERS", MAX_MEMBERS)
    fleet = Fleet(CLOCK)
    settle(fleet.inventory)
    there(fleet.inventory, FRONT)
    for number in range(MAX_MEMBERS + 500):
        fleet.see(seen(1, {}, key=invented(number)), 0, S)
    there(fleet.inventory, NEW)
    assert fleet.inventory.online(NEW)
    assert fleet.inventory.online(FRONT)
    assert fleet.cameras <= MAX_MEMBERS // CLAIMED_PART + 2


def test_names_that_only_messages_claim_leave_before_a_robot_that_is_off() -> None:
    inventory = Inventory()
    there(inventory, FRONT)
    there(inventory, FRONT, alive=False)
    for number in range(2 * INVENTED):
        inventory.see(seen(1, {}, key=invented(number)), number)
    assert inventory.camera(FRONT) is not None
    assert inventory.camera(invented(0)) is None


def test_a_camera_with_an_open_alert_stays_and_what_left_is_given_up() -> None:
    inventory = Inventory()
    inventory.member_limit.held = lambda: {("x0", "front")}
    changes = []
    for number in range(INVENTED):
        for seq in range(6):
            changes += inventory.see(seen(seq, {"box": 1}, key=invented(number)), (seq + 1) * S) or []
    assert inventory.camera(invented(0)) is not None
    assert inventory.camera(invented(1)) is None
    changes += inventory.tick(9 * S)
    gone = {change.sighting.key for change in changes if change.kind is ChangeKind.LOST}
    assert len(gone) == inventory.member_limit.made == INVENTED - len(inventory.cameras())
    assert invented(1) in gone


def test_where_all_are_present_a_further_name_is_left_out_and_that_is_a_problem() -> None:
    inventory = Inventory()
    for number in range(MOST):
        inventory.camera_presence(invented(number), alive=True)
    with pytest.raises(InventoryFullError, match="2,000 cameras are followed"):
        inventory.see(seen(1, {}), S)
    inventory.tick(S)
    (problem,) = inventory.member_limit.problems()
    assert "all are present or have open alerts" in problem
    inventory.tick(S + SHOWN_NS)
    assert inventory.member_limit.problems() == []
    inventory.camera_presence(invented(7), alive=False)
    assert inventory.see(seen(1, {}), S) is not None
    assert inventory.camera(invented(7)) is None


def test_no_robot_takes_more_than_its_share() -> None:
    inventory = Inventory()
    there(inventory, CameraKey("r2", "front"))
    there(inventory, FRONT)
    for number in range(5 * MOST_CAMERAS):
        inventory.see(seen(1, {}, key=CameraKey("r1", f"c{number}")), S)
    assert len(inventory.in_order("r1")) <= MOST_CAMERAS
    assert inventory.online(FRONT)
    assert inventory.in_order("r2")
    for number in range(MOST_CAMERAS - 1):
        inventory.camera_presence(CameraKey("r1", f"d{number}"), alive=True)
    with pytest.raises(InventoryFullError, match="r1 has 256 cameras"):
        inventory.see(seen(1, {}, key=CameraKey("r1", "one-more")), S)


def test_a_history_full_of_invented_names_leaves_room_after_a_restart() -> None:
    inventory = Inventory()
    inventory.restore(
        Sighting(
            key=invented(n), name="box", count=1, score=1, first_ns=1, since_ns=1, last_ns=n, model="m", worker="w"
        )
        for n in range(INVENTED)
    )
    inventory.recall({(f"y{n}", camera): S for n in range(INVENTED) for camera in ("", "front")}, 0)
    assert len(inventory.cameras()) <= MOST
    for number in range(100):
        there(inventory, CameraKey(f"r{number}", "front"))
    assert all(inventory.online(CameraKey(f"r{number}", "front")) for number in range(100))
    assert inventory.camera(invented(INVENTED - MOST)) is None
    assert len(inventory.cameras()) <= MOST


def test_who_tracks_cameras_forgets_those_that_left_and_meets_them_when_they_are_back() -> None:
    inventory = Inventory()
    tracker = AvailabilityTracker(inventory, lambda _camera, _now: True, available=False)
    inventory.see(seen(1, {}), S)
    assert [view.key for view in tracker.advance(S)] == [FRONT]
    for number in range(MOST):
        inventory.see(seen(1, {}, key=invented(number)), S)
    turned = tracker.advance(2 * S)
    assert turned[-1].key == FRONT  # once more, as it left
    assert len(turned) == len(inventory.cameras()) + 1
    inventory.see(seen(1, {}), S)
    assert [view.key for view in tracker.advance(3 * S)] == [FRONT]


def test_the_classes_of_all_cameras_take_no_more_memory_than_they_may(monkeypatch: pytest.MonkeyPatch) -> None:
    most = 200_000
    for module in (inventory_module, view_module):
        monkeypatch.setattr(module, "MAX_CLASS_BYTES", most)
    inventory = Inventory()
    settle(inventory)
    there(inventory, FRONT)
    inventory.see(seen(0, {"box": 1}), S)
    for number in range(100):
        inventory.see(seen(0, {f"{number} {each}": 1 for each in range(60)}, key=invented(number)), S)
    names = [name for view in inventory.cameras() for each in view.views.values() for name in each.classes]
    assert sum(map(bytes_of, names)) <= most + bytes_of(names[-1])
    inventory.tick(2 * S)
    assert "classes of all cameras" in inventory.member_limit.problems()[0]
    inventory.see(seen(1, {"box": 1, "pallet": 1}), 2 * S)
    inventory.tick(3 * S)
    inventory.see(seen(2, {"box": 1, "pallet": 1}), 3 * S)
    (front,) = [view for view in inventory.cameras() if view.key == FRONT]
    assert front.primary is not None
    assert front.primary.classes.keys() == {"box", "pallet"}


def test_of_a_list_with_very_many_classes_the_first_are_looked_at() -> None:
    inventory = Inventory()
    inventory.see(seen(0, {f"c{number:03}": 1 for number in range(1_000)}), S)
    (view,) = inventory.cameras()
    assert view.primary is not None
    assert len(view.primary.classes) == MAX_CLASSES
    assert max(view.primary.classes) < f"c{MOST_LISTED:03}"


def test_until_cameras_had_time_to_announce_themselves_none_leaves_for_that() -> None:
    fleet = Fleet(CLOCK)
    fleet.tick(S)
    for number in range(MOST // CLAIMED_PART + 100):
        fleet.see(seen(1, {}, key=invented(number)), 0, S)
    assert fleet.cameras == MOST // CLAIMED_PART + 100
    fleet.tick(S + SETTLED_NS)
    fleet.see(seen(1, {}, key=invented(MOST)), 0, S)
    assert fleet.cameras < MOST // CLAIMED_PART + 100


def test_of_a_camera_that_left_while_all_are_listed_there_is_nothing() -> None:
    inventory = Inventory()
    for number in range(3):
        for seq in (1, 2, 3):
            inventory.see(seen(seq, {"box": 1}, key=invented(number)), seq * S)
    listed = inventory.entries(3 * S)
    assert next(listed).sighting.key == invented(0)
    inventory._leave([invented(1)])
    assert {each.sighting.key for each in listed} == {invented(2)}
