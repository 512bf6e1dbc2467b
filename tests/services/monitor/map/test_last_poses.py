from services.monitor.liveness import POSE_LIVE_NS
from services.monitor.map.last_seen import FORGET_NS, MAX_POSES, LastPoses
from services.monitor.map.pose import Pose

NOW = 10**18


def pose(x: float = 1.0, at_ns: int = NOW) -> Pose:
    return Pose(x, 2.0, 0.5, at_ns)


def shown(last: LastPoses, now_ns: int, online: set[str], robot: str = "") -> list[tuple[str, float, bool]]:
    return [(each.name, each.pose.x, each.live) for each in last.robots(now_ns, online, robot=robot)]


def test_a_robot_whose_gateway_goes_stays_where_it_was_and_is_not_live() -> None:
    last = LastPoses()
    last.take({"r1": pose(), "r2": pose(3.0)}, NOW)
    assert shown(last, NOW, {"r1", "r2"}) == [("r1", 1.0, True), ("r2", 3.0, True)]
    last.take({"r2": pose(4.0, NOW + 1)}, NOW + 1)
    assert shown(last, NOW + 1, {"r2"}) == [("r1", 1.0, False), ("r2", 4.0, True)]
    assert shown(last, NOW + 1, {"r2"}, "r1") == [("r1", 1.0, False)]
    last.take({"r1": pose(5.0, NOW + 2)}, NOW + 2)
    assert shown(last, NOW + 2, {"r1", "r2"}) == [("r1", 5.0, True), ("r2", 4.0, True)]


def test_a_pose_of_which_nothing_was_heard_for_a_while_is_not_of_now() -> None:
    last = LastPoses()
    last.take({"r1": pose()}, NOW)
    assert shown(last, NOW + POSE_LIVE_NS, {"r1"}) == [("r1", 1.0, True)]
    assert shown(last, NOW + POSE_LIVE_NS + 1, {"r1"}) == [("r1", 1.0, False)]


def test_a_robot_is_forgotten_half_an_hour_after_its_pose_was_last_known() -> None:
    last = LastPoses()
    last.take({"r1": pose(), "still": pose()}, NOW)
    last.take({"still": pose()}, NOW + 1)
    assert [name for name, *_ in shown(last, NOW + FORGET_NS, set())] == ["r1", "still"]
    assert [name for name, *_ in shown(last, NOW + FORGET_NS + 1, set())] == ["still"]
    assert last.names(NOW + FORGET_NS) == {"r1", "still"}
    assert last.names(NOW + FORGET_NS + 1) == {"still"}


def test_a_robot_that_somebody_forgot_is_left_out_for_as_long_as_that_holds() -> None:
    gone = {"r1"}
    last = LastPoses(gone.__contains__)
    last.take({"r1": pose(), "r2": pose()}, NOW)
    assert [name for name, *_ in shown(last, NOW, {"r2"})] == ["r2"]
    assert last.names(NOW) == {"r2"}
    gone.clear()
    assert last.names(NOW) == {"r1", "r2"}


def test_so_many_are_kept_those_known_last() -> None:
    last = LastPoses()
    for number in range(MAX_POSES):
        last.take({f"r{number}": pose()}, NOW)
    last.take({"r0": pose()}, NOW + 1)
    last.take({"new": pose()}, NOW + 2)
    assert len(last.names(NOW + 2)) == MAX_POSES
    assert {"r0", "new"} <= last.names(NOW + 2)
    assert "r1" not in last.names(NOW + 2)


def test_a_pose_that_objects_told_is_taken_if_it_is_newer() -> None:
    last = LastPoses()
    last.take({"r1": pose(1.0, NOW)}, NOW + 5)
    last.take_seen({"r1": pose(2.0, NOW), "r2": pose(3.0, NOW - 1)})
    assert shown(last, NOW, {"r1", "r2"}) == [("r1", 1.0, True), ("r2", 3.0, True)]
    last.take_seen({"r1": pose(2.0, NOW + 1)})
    assert shown(last, NOW + 1, {"r1"}, "r1") == [("r1", 2.0, True)]
    assert last.names(NOW + FORGET_NS) == {"r1"}


def test_a_newer_pose_is_taken_though_the_clock_was_set_back() -> None:
    last = LastPoses()
    last.take_seen({"r1": pose(1.0, NOW)})
    last.take_seen({"r1": pose(2.0, NOW - FORGET_NS)})
    assert shown(last, NOW - FORGET_NS, {"r1"}) == [("r1", 2.0, True)]
