import msgspec
import pytest

from schemas.keys import CameraKey
from services.monitor.inventory import inventory as module
from services.monitor.inventory import member_limit as room_module
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.inventory.member_limit import InventoryFullError
from services.monitor.inventory.sighting import ChangeKind, Sighting
from services.monitor.inventory.view import MAX_CLASSES
from services.monitor.settings import InventorySettings
from tests.schemas.results import distances, known
from tests.services.monitor.inventory.seeing import FRONT, S, going_on, seen

REAR = CameraKey("r1", "rear")


def quick() -> Inventory:
    return Inventory(TrustLimits(Debounce(1, 0, 1, 0), stale_ns=3 * S, lost_ns=60 * S))


def online(inventory: Inventory, key: CameraKey = FRONT) -> None:
    inventory.robot_presence(key.robot, alive=True)
    inventory.camera_presence(key, alive=True)


def seen_of(inventory: Inventory) -> list[Sighting]:
    return [entry.sighting for entry in inventory.entries(0)]


@pytest.mark.parametrize("lost", ["nothing", "robot", "camera"])
def test_only_what_is_online_is_available_and_the_rest_stays(lost: str) -> None:
    inventory = quick()
    online(inventory)
    inventory.see(seen(0, {"box": 2}), 9 * S)
    inventory.see(seen(1, {"box": 2}), 10 * S)
    if lost == "robot":
        inventory.robot_presence("r1", alive=False)
    if lost == "camera":
        inventory.camera_presence(FRONT, alive=False)
    (entry,) = inventory.entries(11 * S)
    assert entry.available is (lost == "nothing")
    assert (entry.sighting.count, entry.sighting.last_ns) == (2, 10 * S)


@pytest.mark.parametrize(("age_ns", "available"), [(3 * S, True), (3 * S + 1, False)])
def test_a_silent_camera_is_not_available(age_ns: int, *, available: bool) -> None:
    inventory = quick()
    online(inventory)
    inventory.see(seen(0, {"box": 1}), 9 * S)
    inventory.see(seen(1, {"box": 1}), 10 * S)
    (entry,) = inventory.entries(10 * S + age_ns)
    assert entry.available is available


def test_a_second_opinion_makes_no_camera_and_is_looked_at_once_there_is_one() -> None:
    inventory = quick()
    assert not inventory.opine(seen(0, {"box": 2}, model="new"), S)
    assert list(inventory.in_order()) == []
    online(inventory)
    for seq in (1, 2):
        assert inventory.opine(seen(seq, {"box": 2}, model="new"), seq * S)
    assert list(inventory.entries(2 * S)) == []
    for seq in (1, 2):
        inventory.see(seen(seq, {"box": 1}), seq * S)
    assert not inventory.opine(seen(2, {"box": 2}, model="new"), 3 * S)
    camera = inventory.camera(FRONT)
    assert camera is not None
    assert camera.disagreements(S) == {"box": (1, 2)}
    inventory.tick(65 * S)
    assert inventory.disputed() == {FRONT}
    inventory.tick(65 * S + 1)
    assert inventory.disputed() == set()
    assert [(each.sighting.count, each.sighting.model) for each in inventory.entries(3 * S)] == [(1, "m")]


def test_entries_are_ordered_and_can_be_asked_for_one_by_one() -> None:
    inventory = quick()
    other = CameraKey("r2", "front")
    for key in (other, REAR, FRONT):
        inventory.see(seen(0, {"pallet": 1, "box": 1}, key=key), S)
    every = [(str(entry.sighting.key), entry.sighting.name) for entry in inventory.entries(S)]
    assert every == [(key, name) for key in ("r1/front", "r1/rear", "r2/front") for name in ("box", "pallet")]
    assert len(list(inventory.entries(S, robot="r1"))) == 4
    assert len(list(inventory.entries(S, camera="front", name="box"))) == 2
    assert list(inventory.entries(S, robot="r3")) == []


@pytest.mark.parametrize(("silent_ns", "kinds"), [(60 * S, []), (60 * S + 1, [ChangeKind.LOST])])
def test_after_long_silence_it_is_not_known_what_is_in_view(silent_ns: int, kinds: list[ChangeKind]) -> None:
    inventory = quick()
    inventory.camera_presence(REAR, alive=True)
    inventory.see(seen(0, {"box": 1}), S)
    assert [change.kind for change in inventory.tick(S + silent_ns)] == kinds
    assert inventory.tick(S + silent_ns) == [] or not kinds
    assert len(going_on(inventory)) == 1 - len(kinds)


def test_what_a_store_kept_is_there_until_the_camera_says_otherwise() -> None:
    before = quick()
    before.see(seen(7, {"box": 1}), 10 * S)
    after = quick()
    after.restore([entry.sighting for entry in before.entries(10 * S)])
    online(after)
    (entry,) = after.entries(30 * S)
    assert (entry.available, entry.sighting.first_ns) == (False, 10 * S)
    assert after.see(seen(8, {"box": 1}), 31 * S) == []
    (entry,) = after.entries(31 * S)
    assert not entry.available, "one list alone may be the last one of a worker that is gone"
    assert after.see(seen(9, {"box": 1}), 32 * S) == []
    (entry,) = after.entries(32 * S)
    assert (entry.available, entry.sighting.first_ns, entry.sighting.last_ns) == (True, 10 * S, 32 * S)


def test_what_comes_after_long_silence_is_new_even_if_nobody_noticed_the_silence() -> None:
    before, after = quick(), quick()
    before.see(seen(7, {"box": 1}), 10 * S)
    after.restore(going_on(before))
    changes = after.see(seen(8, {"box": 1, "pallet": 1}), 7_200 * S)
    assert changes is not None
    assert [(of.kind, of.sighting.name, of.sighting.last_ns, of.first_look) for of in changes] == [
        (ChangeKind.LOST, "box", 10 * S, False),
        (ChangeKind.APPEARED, "box", 7_200 * S, True),
        (ChangeKind.APPEARED, "pallet", 7_200 * S, True),
    ]
    assert after.tick(7_200 * S) == []


def test_a_list_that_was_taken_before_is_no_news_after_long_silence_either() -> None:
    inventory = quick()
    inventory.see(seen(7, {"box": 1}), 10 * S)
    assert inventory.see(seen(7, {"box": 1}), 7_200 * S) is None
    assert [(of.kind, of.sighting.last_ns) for of in inventory.tick(7_200 * S)] == [(ChangeKind.LOST, 10 * S)]


def test_the_model_that_spoke_last_goes_on_after_a_restart_with_what_others_saw_before() -> None:
    def kept(name: str, count: int, last_s: int, model: str) -> Sighting:
        return Sighting(FRONT, name, count, 0.5, S, last_s * S, last_s * S, model, "w")

    inventory = quick()
    inventory.restore([kept("cat", 0, 2, "old"), kept("box", 1, 100, "new"), kept("tree", 0, 50, "older")])
    assert {(of.name, of.count, of.model) for of in seen_of(inventory)} == {
        ("cat", 0, "new"),
        ("box", 1, "new"),
        ("tree", 0, "new"),
    }
    assert inventory.see(seen(1, {"box": 1}, model="new"), 101 * S) == []


def test_what_publishers_kept_of_the_time_before_a_restart_did_not_appear_after_it() -> None:
    before, after = Inventory(), Inventory()
    lists = [seen(seq, {"box": 1, "cat": 60 <= seq < 70}) for seq in range(100)]
    for number, each in enumerate(lists):
        before.see(each, S + number * S // 2)
    after.restore(seen_of(before))
    again = [after.see(each, 60 * S + number) for number, each in enumerate(lists)]
    assert [(of.sighting.name, of.first_look) for some in again for of in some or ()] == [("cat", True)]
    later = [after.see(seen(seq, {"box": 1, "pallet": 1}), seq * S) for seq in (100, 101)]
    assert [(of.sighting.name, of.first_look) for some in later for of in some or () if of.sighting.count] == [
        ("pallet", False)
    ]


def test_of_many_classes_that_were_seen_a_camera_remembers_what_is_in_view_and_the_newest_others() -> None:
    inventory = quick()
    some = [Sighting(FRONT, f"c{n}", n == 1, 0.5, S, n * S, n * S, "m", "w") for n in range(1, MAX_CLASSES + 9)]
    inventory.restore(some)
    found = {of.name for of in seen_of(inventory)}
    assert (len(found), {"c1", some[-1].name} <= found) == (MAX_CLASSES, True)


def test_when_the_clock_is_set_back_the_gateway_that_runs_on_alone_is_heard_soon() -> None:
    inventory = quick()
    for boot_id in ("a", "b"):
        inventory.see(seen(1, {"box": 1}, boot_id=boot_id), 3_600 * S)
        inventory.measure(msgspec.structs.replace(distances(), header=seen(1, {}, boot_id=boot_id).header), 3_600 * S)
    inventory.tick(3_600 * S)
    inventory.tick(10 * S)
    again = seen(2, {"box": 1}, boot_id="a")
    assert inventory.see(again, 14 * S) is not None
    assert inventory.measure(msgspec.structs.replace(distances(), header=again.header), 14 * S)


def test_when_the_clock_is_set_back_who_is_silent_does_not_speak_until_it_has_caught_up() -> None:
    inventory = quick()
    online(inventory)
    for seq in (1, 2):
        inventory.see(seen(seq, {"box": 1}, model="gone"), 3_600 * S)
    inventory.tick(3_600 * S)
    inventory.tick(10 * S)
    (entry,) = inventory.entries(14 * S)
    assert not entry.available
    inventory.see(seen(3, {"pallet": 1}, model="other"), 14 * S)
    assert {(of.name, of.model) for of in going_on(inventory)} == {("box", "other"), ("pallet", "other")}
    assert [of.kind for of in inventory.tick(80 * S)] == [ChangeKind.LOST, ChangeKind.LOST]


def test_distances_are_of_the_newest_frame_only() -> None:
    inventory = quick()
    inventory.see(seen(0, {"box": 1}), S)
    assert inventory.measure(distances(known("box", 2.0), seq=1), S)
    assert not inventory.measure(distances(known("box", 1.0), seq=0), S)
    assert not inventory.measure(distances(known("box", 1.0), seq=1), S)
    assert inventory.ignored_distances == 2
    (entry,) = inventory.entries(S)
    assert entry.sighting.nearest_m == 2.125
    (entry,) = inventory.entries(S + 3 * S + 1)
    assert entry.sighting.nearest_m is None


def test_members_are_bounded_and_those_known_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_MEMBERS", 1)
    monkeypatch.setattr(room_module, "MAX_MEMBERS", 1)
    inventory = quick()
    online(inventory)
    with pytest.raises(InventoryFullError, match="r1/rear"):
        inventory.see(seen(0, {}, key=REAR), S)
    with pytest.raises(InventoryFullError):
        inventory.measure(distances(camera="rear"), S)
    with pytest.raises(InventoryFullError):
        inventory.robot_presence("r2", alive=True)
    assert inventory.see(seen(0, {"box": 1}), S)
    (sighting,) = going_on(inventory)
    other = quick()
    other.camera_presence(REAR, alive=True)
    other.restore([sighting])
    assert going_on(other) == []


def test_settings_are_seconds() -> None:
    limits = InventorySettings(appear_lists=3, vanish_s=0.5, stale_s=2, lost_s=10).limits()
    assert limits == TrustLimits(Debounce(3, 0, 2, S // 2), stale_ns=2 * S, lost_ns=10 * S)


def test_cameras_are_in_order_by_robot_and_name_and_those_of_one_robot_are_found() -> None:
    inventory = quick()
    others = [CameraKey("r10", "front"), CameraKey("r0", "front"), CameraKey("r2", "front")]
    for key in (REAR, *others, FRONT):
        inventory.camera_presence(key, alive=True)
    assert inventory.in_order() == (others[1], FRONT, REAR, others[0], others[2])
    assert inventory.in_order("r1") == (FRONT, REAR)
    assert inventory.in_order("r3") == ()


def test_whoever_follows_is_told_of_what_is_new_comes_or_goes() -> None:
    inventory = quick()
    online(inventory)
    news = inventory.follow()
    assert (news.cameras, news.robots) == ({FRONT}, {"r1"})
    news.cameras.clear()
    inventory.robot_presence("r1", alive=False)
    assert news.cameras == {FRONT}
    news.cameras.clear()
    inventory.camera_presence(FRONT, alive=False)
    assert news.cameras == {FRONT}
    news.robots.clear()
    inventory.see(seen(0, {}, key=REAR), S)
    assert (REAR in news.cameras, news.robots) == (True, {"r1"})


def test_who_follows_and_takes_no_news_is_told_of_no_more_robots_than_there_may_be(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "MAX_MEMBERS", 3)
    inventory = quick()
    news = inventory.follow()
    for number in range(9):
        for alive in (True, False):
            inventory.robot_presence(f"r{number}", alive=alive)
    assert len(news.robots) == 3


def test_a_robot_that_is_forgotten_is_on_no_list_until_its_gateway_is_back() -> None:
    inventory = quick()
    for key in (FRONT, CameraKey("r0", "front"), CameraKey("r2", "front")):
        online(inventory, key)
    inventory.see(seen(0, {"box": 2}), 9 * S)
    with pytest.raises(ValueError, match="r1 is there"):
        inventory.forget("r1")
    inventory.robot_presence("r1", alive=False)
    news = inventory.follow()
    news.robots.clear()
    news.cameras.clear()
    inventory.forget("r1")
    inventory.see(seen(1, {"box": 2}), 10 * S)
    inventory.camera_presence(REAR, alive=False)
    assert [key.robot for key in inventory.in_order()] == ["r0", "r2"]
    assert (inventory.in_order("r1"), seen_of(inventory)) == ((), [])
    assert inventory.is_forgotten("r1")
    assert not inventory.is_forgotten("r0")
    assert (news.robots, news.cameras) == ({"r1"}, {FRONT, REAR})
    inventory.robot_presence("r1", alive=True)
    assert [key.robot for key in inventory.in_order()] == ["r0", "r1", "r1", "r2"]
    assert [(each.key, each.count, each.last_ns) for each in seen_of(inventory)] == [(FRONT, 2, 10 * S)]
    assert not inventory.is_forgotten("r1")


def test_a_robot_that_was_there_before_a_restart_is_forgotten_too() -> None:
    inventory = Inventory()
    inventory.recall({("r1", ""): 9 * S, ("r1", "front"): 9 * S}, 5 * S)
    inventory.forget("r1")
    assert (inventory.recalled(), inventory.in_order()) == ({}, ())


def test_who_was_there_before_a_restart_is_known_and_who_was_so_lately_is_missed() -> None:
    inventory = Inventory()
    news = inventory.follow()
    inventory.recall({("r1", ""): 9 * S, ("r2", ""): 2 * S, ("r1", "front"): 9 * S, ("r2", "front"): 2 * S}, 5 * S)
    assert inventory.recalled() == {"r1": 9 * S, "r2": 2 * S}
    assert (news.robots, news.cameras) == ({"r1"}, {FRONT})
    assert inventory.in_order() == (FRONT,)
    assert not inventory.robots()


def test_of_too_many_who_were_there_the_newest_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_MEMBERS", 2)
    inventory = Inventory()
    inventory.recall({(f"r{n}", camera): n * S for n in range(1, 5) for camera in ("", "front")}, 0)
    assert set(inventory.recalled()) == {"r3", "r4"}
    assert {key.robot for key in inventory.in_order()} == {"r3", "r4"}


def test_opinions_that_are_not_taken_are_counted() -> None:
    inventory = quick()
    inventory.see(seen(1, {"box": 1}), S)
    assert [inventory.opine(seen(seq, {"box": 1}), S) for seq in (5, 5, 4, 6)] == [True, False, False, True]
    assert not inventory.opine(seen(7, {"box": 1}, key=CameraKey("r1", "unknown")), S)
    assert (inventory.ignored_opinions, inventory.refused.total()) == (3, 0)


def test_a_camera_that_makes_room_leaves_no_count_of_late_lists_behind() -> None:
    inventory = quick()
    assert [inventory.see(seen(1, {"box": 1}), S) is None for _ in range(2)] == [False, True]
    assert inventory.refused == {FRONT: 1}
    inventory._leave([FRONT])
    assert not inventory.refused
