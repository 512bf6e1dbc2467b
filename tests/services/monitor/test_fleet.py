from contextlib import suppress

import msgspec
import pytest

from schemas.detections import ClassCount
from schemas.distances import ObjectDistance, Place
from schemas.keys import CameraKey
from schemas.status import ClockReading, WorkerStatus
from services.monitor import fleet as fleet_module
from services.monitor.duplicate_gateways import DUPLICATE_GATEWAY
from services.monitor.fleet import RATE_WINDOW_S, Age, Fleet, Row
from services.monitor.inventory import member_limit as module
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import TrustLimits
from services.monitor.inventory.member_limit import InventoryFullError
from services.monitor.inventory.sighting import Sighting
from services.monitor.liveness import STALE_S
from services.monitor.robot_clocks import MAX_LAG_NS
from tests.schemas.frames import header
from tests.schemas.results import distances, known
from tests.services.monitor.sightings import CLOCK, FRONT, S, online_fleet, seen, status


def only(fleet: Fleet, now_s: float) -> Row:
    (row,) = fleet.rows(now_s)
    return row


def test_a_camera_is_listed_before_its_first_class_list() -> None:
    row = only(online_fleet(), 0)
    assert row == Row(key=FRONT, online=True, classes=None, age=None, rate_hz=0)
    assert row.stale


def test_a_class_list_fills_the_row_and_ages_from_the_gateways_receive_time() -> None:
    fleet = online_fleet()
    for seq in (0, 1):
        message = seen(seq, box=2)
        assert fleet.see(message, 10.0, message.header.received_ns + 250_000_000) is not None
    row = only(fleet, 11.0)
    assert row.classes == (ClassCount("box", 2, 0.9),)
    assert row.age == Age(1.25, exact=True)
    assert list(fleet.ages_s) == [0.25, 0.25]


def test_a_list_that_comes_again_is_counted_apart() -> None:
    fleet = online_fleet()
    for seq in (5, 5, 4, 6):
        fleet.see(seen(seq), 10.0, S)
    assert (fleet.class_lists, fleet.refused_lists) == (2, 2)
    assert fleet.inventory.refused == {FRONT: 2}


def test_a_row_counts_what_is_settled_and_what_one_list_alone_says_is_neither_there_nor_gone() -> None:
    fleet = online_fleet()
    lists = iter(
        msgspec.structs.replace(seen(seq), classes=[ClassCount(name, 1, 0.9) for name in names])
        for seq, names in enumerate(("pb", "pb", "pbg", "b", "pb", "b", "b", "b"))
    )
    shown = []
    for at_s, each in enumerate(lists):
        fleet.see(each, at_s, at_s * S)
        classes = only(fleet, at_s).classes
        shown.append(None if classes is None else "".join(of.name for of in classes))
    assert shown == [None, "bp", "bp", "bp", "bp", "bp", "b", "b"]
    fleet.see(msgspec.structs.replace(seen(8), classes=[ClassCount("b", 0, 0.0)]), 8, 8 * S)
    fleet.see(msgspec.structs.replace(seen(9), classes=[ClassCount("b", 0, 0.0)]), 9, 9 * S)
    assert only(fleet, 9).classes == ()


def test_that_nothing_is_in_view_is_known_as_soon_as_what_is() -> None:
    fleet = online_fleet()
    for seq, classes in enumerate((None, ())):
        fleet.see(msgspec.structs.replace(seen(seq), classes=[]), 0, 0)
        assert only(fleet, 0).classes == classes


def test_a_row_has_the_scores_of_the_newest_list_whatever_it_counts() -> None:
    fleet = online_fleet()
    for seq in (0, 1):
        fleet.see(seen(seq), 10.0, 0)
    assert [row.key for row in fleet.take_changed(10.0)] == [FRONT]
    before = only(fleet, 10.0)
    surer = msgspec.structs.replace(seen(2), classes=[ClassCount("box", 1, 0.95)])
    assert fleet.see(surer, 11.0, 0) is not None
    assert only(fleet, 11.0).classes == (ClassCount("box", 1, 0.95),)
    assert before.classes == (ClassCount("box", 1, 0.9),)
    assert list(fleet.take_changed(11.0)) == []


def test_another_machines_clock_gives_a_lower_bound_only() -> None:
    fleet = online_fleet()
    fleet.gateway_status(status("another machine"), 0)
    fleet.see(seen(), 10.0, 0)
    assert only(fleet, 12.0).age == Age(2.0, exact=False)
    assert not fleet.ages_s


def test_a_clock_that_was_measured_gives_the_age() -> None:
    fleet = online_fleet()
    fleet.gateway_status(status("another machine"), 0)
    assert list(fleet.elsewhere()) == ["r1"]
    assert fleet.clocks.due(fleet.elsewhere(), 0) == ["r1"]
    message = seen()
    theirs_ns, ours_ns = message.header.received_ns, message.header.received_ns + 3_600_000_000_000
    reading = ClockReading(
        robot="r1", boot_id="b", clock_id="another machine", received_ns=theirs_ns, sent_ns=theirs_ns
    )
    fleet.clocks.take("r1", reading, asked_ns=ours_ns - 1000, answered_ns=ours_ns + 1000)
    fleet.see(message, 10.0, ours_ns + 250_000_000)
    assert only(fleet, 11.0).age == Age(1.25, exact=True)
    assert list(fleet.ages_s) == [0.25]


def test_sightings_have_our_time_though_the_robots_clock_is_an_hour_ahead() -> None:
    fleet = Fleet(CLOCK, TrustLimits(Debounce(1, 0, 1, 0)))
    fleet.robot_presence("r1", alive=True)
    fleet.gateway_status(status("another machine"), 0)
    fleet.clocks.due(fleet.elsewhere(), 0)
    ours_ns = 1_700_000_000_000_000_000
    theirs_ns = ours_ns + 3_600_000_000_000
    reading = ClockReading(
        robot="r1", boot_id="b", clock_id="another machine", received_ns=theirs_ns, sent_ns=theirs_ns
    )
    fleet.clocks.take("r1", reading, asked_ns=ours_ns - 1000, answered_ns=ours_ns + 1000)
    message = seen()
    about = msgspec.structs.replace(message.header, received_ns=theirs_ns)
    changes = fleet.see(msgspec.structs.replace(message, header=about), 10.0, ours_ns + 250_000_000)
    assert changes
    assert changes[0].sighting.first_ns == ours_ns


@pytest.mark.parametrize(("old_ns", "exact"), [(MAX_LAG_NS, True), (MAX_LAG_NS + 1, False)])
def test_a_list_that_tells_no_believable_time_is_of_now(old_ns: int, *, exact: bool) -> None:
    fleet = online_fleet()
    message = seen()
    fleet.see(message, 10.0, message.header.received_ns + old_ns)
    age = only(fleet, 10.0).age
    assert age == Age(MAX_LAG_NS / 1e9 if exact else 0.0, exact=exact)


def test_two_gateways_under_one_name_are_a_problem_of_that_robot() -> None:
    fleet = online_fleet()
    fleet.gateway_status(status(robot="r2"), 0)
    for at_ns in (1, 3):
        fleet.gateway_status(msgspec.structs.replace(status(), boot_id="other"), at_ns)
        fleet.gateway_status(status(), at_ns + 1)
    assert (list(fleet.problems_of("r1")), list(fleet.problems_of("r2"))) == ([DUPLICATE_GATEWAY], [])


@pytest.mark.parametrize(("age_s", "stale"), [(STALE_S, False), (STALE_S + 0.01, True)])
def test_a_view_goes_stale(age_s: float, *, stale: bool) -> None:
    fleet = online_fleet()
    message = seen()
    fleet.see(message, 0.0, message.header.received_ns)
    assert only(fleet, age_s).stale is stale


def test_how_old_a_view_may_be_is_what_the_inventory_says() -> None:
    fleet = Fleet(CLOCK, TrustLimits(stale_ns=10 * S))
    fleet.robot_presence("r1", alive=True)
    fleet.camera_presence(FRONT, alive=True)
    fleet.see(seen(), 0.0, 0)
    assert (only(fleet, 10.0).stale, only(fleet, 10.1).stale) == (False, True)


@pytest.mark.parametrize("lost", ["robot", "camera"])
def test_a_lost_robot_or_camera_stays_on_screen_offline(lost: str) -> None:
    fleet = online_fleet()
    for seq in (0, 1):
        fleet.see(seen(seq), 0.0, header().received_ns)
    if lost == "robot":
        fleet.robot_presence("r1", alive=False)
    else:
        fleet.camera_presence(FRONT, alive=False)
    row = only(fleet, 1.0)
    assert (row.online, row.stale, row.classes) == (False, True, (ClassCount("box", 1, 0.9),))
    fleet.robot_presence("r1", alive=True)
    fleet.camera_presence(FRONT, alive=True)
    assert only(fleet, 1.0).online


def test_doubles_and_older_frames_are_dropped_but_a_restarted_gateway_begins_anew() -> None:
    fleet = online_fleet()
    assert fleet.see(seen(5), 0.0, 0) is not None
    assert fleet.see(seen(5), 1.0, 0) is None
    assert fleet.see(seen(4), 1.0, 0) is None
    assert fleet.see(seen(0, boot_id="next"), 2.0, 0) is not None
    assert fleet.lists_per_robot() == {"r1": 2}


def test_rate_over_the_window() -> None:
    fleet = online_fleet()
    for seq in range(5):
        fleet.see(seen(seq), seq * 0.5, 0)
    assert only(fleet, 2.0).rate_hz == 2.0
    assert only(fleet, 2.0 + RATE_WINDOW_S).rate_hz == 0.0


def test_robots_without_lists_are_counted_too_and_rows_are_ordered() -> None:
    fleet = online_fleet()
    fleet.robot_presence("r0", alive=True)
    fleet.see(seen(robot="r2"), 0.0, 0)
    assert fleet.lists_per_robot() == {"r0": 0, "r1": 0, "r2": 1}
    assert [str(row.key) for row in fleet.rows(0.0)] == ["r1/front", "r2/front"]


def test_members_are_bounded_and_those_known_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_MEMBERS", 1)
    monkeypatch.setattr(fleet_module, "MAX_MEMBERS", 1)
    fleet = online_fleet()
    assert fleet.see(seen(0), 0.0, 0) is not None
    with pytest.raises(InventoryFullError, match="r2"):
        fleet.see(seen(0, robot="r2"), 0.0, 0)
    with pytest.raises(InventoryFullError):
        fleet.robot_presence("r2", alive=True)
    with pytest.raises(InventoryFullError):
        fleet.camera_presence(CameraKey("r1", "rear"), alive=True)
    with pytest.raises(InventoryFullError):
        fleet.gateway_status(status(robot="r2"), 0)
    assert fleet.see(seen(1), 1.0, 0) is not None
    fleet.robot_presence("r2", alive=False)


def test_a_camera_that_only_the_history_knows_is_listed_as_offline_with_what_it_showed_last() -> None:
    fleet = Fleet(CLOCK)
    sighting = Sighting(
        key=FRONT, name="box", count=1, score=0.5, first_ns=1, since_ns=1, last_ns=2, model="m", worker="w"
    )
    fleet.inventory.restore([sighting])
    row = only(fleet, 0)
    assert row == Row(key=FRONT, online=False, classes=(ClassCount("box", 1, 0.5),), age=None, rate_hz=0)
    assert row.stale


def test_a_frame_s_age_is_exact_where_the_clock_is_ours_and_else_since_it_came() -> None:
    fleet = online_fleet()
    about = header()
    now_ns = about.received_ns + 3_000_000_000
    assert fleet.age_of(about, now_ns - 1_000_000_000, now_ns) == Age(3.0, exact=True)
    fleet.gateway_status(status("another machine"), 0)
    assert fleet.age_of(about, now_ns - 1_000_000_000, now_ns) == Age(1.0, exact=False)


def placed() -> ObjectDistance:
    """Return a box whose place in the map is known."""
    found = known("box", 2.0)
    assert found.measured is not None
    place = Place(frame_id="map", at=(1.0, 2.0, 0.0))
    return msgspec.structs.replace(found, measured=msgspec.structs.replace(found.measured, places=[place]))


def test_distances_say_where_things_are_and_doubles_say_it_once() -> None:
    fleet = online_fleet()
    assert fleet.measure(distances(placed()), 5)
    assert not fleet.measure(distances(placed()), 9)
    (mark,) = fleet.places.marks(9)
    assert (mark.x, mark.y, mark.seen_ns) == (1.0, 2.0, 5)


def test_distances_are_of_when_their_frame_came_however_late_they_are() -> None:
    fleet = online_fleet()
    for seq in (0, 1):
        fleet.see(seen(seq), 1.0, header().received_ns)
    late = distances(placed())
    now_ns = late.header.received_ns + round(STALE_S * S) + 1
    assert fleet.measure(late, now_ns)
    (entry,) = fleet.inventory.entries(now_ns)
    (mark,) = fleet.places.marks(now_ns)
    assert (entry.sighting.nearest_m, mark.seen_ns) == (None, late.header.received_ns)


def test_where_things_are_is_as_old_as_before_when_the_clock_is_set_back() -> None:
    fleet = online_fleet()
    fleet.measure(distances(placed()), 9 * S)
    assert (fleet.tick(10 * S), fleet.tick(5 * S)) == ([], [])
    (mark,) = fleet.places.marks(5 * S)
    assert mark.seen_ns == 4 * S


def test_a_second_opinion_is_of_when_its_frame_came_and_counts_as_no_class_list() -> None:
    fleet = online_fleet()
    for seq in (0, 1):
        message = seen(seq, box=2)
        assert fleet.opine(message, message.header.received_ns + 250_000_000)
    row = only(fleet, 1.0)
    assert (row.classes, row.age, row.rate_hz) == (None, None, 0)
    assert (fleet.class_lists, fleet.first_list_s, list(fleet.ages_s)) == (0, None, [])
    view = fleet.inventory.camera(FRONT)
    assert view is not None
    assert view.opinions["m"].last_ns == seen(1).header.received_ns
    assert not fleet.opine(seen(1), 0)


def test_what_workers_say_they_report_is_compared_though_it_was_never_in_a_list() -> None:
    fleet = online_fleet()
    says = WorkerStatus(service="opinion", worker="w", model="new", sent_ns=0, classes=["box"])
    fleet.worker_status(says, 0)
    for seq in (0, 1):
        fleet.see(seen(seq), 0, seq)
        assert fleet.opine(msgspec.structs.replace(seen(seq), classes=[]), seq)
    view = fleet.inventory.camera(FRONT)
    assert view is not None
    assert view.disagreements(0) == {"box": (1, 0)}
    fleet.worker_status(msgspec.structs.replace(says, classes=[]), 0)
    assert view.disagreements(0) == {}


def worker(number: int) -> WorkerStatus:
    return WorkerStatus(service="detector", worker=f"w{number}", model="m", sent_ns=0, classes=["box"])


def test_a_worker_that_is_silent_for_a_day_is_forgotten_once_another_one_comes() -> None:
    fleet = Fleet(CLOCK)
    for second, number in enumerate((1, 2, 1)):
        fleet.worker_status(worker(number), second * S)
    fleet.worker_status(worker(3), 86_401 * S)
    assert [name for _, name in fleet.workers] == ["w1", "w2", "w3"]
    fleet.worker_status(worker(4), 86_402 * S)
    assert [name for _, name in fleet.workers] == ["w1", "w3", "w4"]
    assert fleet.workers.keys() == fleet.worker_heard_ns.keys()


def test_workers_that_are_restarted_over_and_over_leave_room_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_MEMBERS", 10)
    monkeypatch.setattr(fleet_module, "MAX_MEMBERS", 10)
    fleet = Fleet(CLOCK)
    for number in range(1, 1_000):
        for each in (0, number):
            fleet.worker_status(worker(each), number * 10 * S)
        assert ("detector", "w0") in fleet.workers
    for number in range(1_000, 1_010):
        with suppress(InventoryFullError):
            fleet.worker_status(worker(number), 10_000 * S)
    with pytest.raises(InventoryFullError):
        fleet.worker_status(worker(2_000), 10_000 * S)
