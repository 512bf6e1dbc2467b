"""Objects that are near robots."""

import math
from typing import Any

import msgspec

from schemas.world import Seer, WorldObject
from services.monitor.map.pose import Pose
from tests.services.monitor.world.test_conditions import APPEARED, Hall, S, rule
from tests.services.monitor.world.test_site_objects import thing


def test_an_object_is_near_a_robot_whoever_saw_it_and_the_alert_is_the_robot_s() -> None:
    hall = Hall(rule("near_robot", than_m=2, robots=["r*"], action={"name": "slow", "payload": "{class} {robot}"}))
    hall.robots = ["r1", "r2", "x1"]
    for robot, x in (("r1", 0.0), ("r2", 30.0), ("x1", 0.0)):
        hall.poses[robot] = Pose(x, 1.0, 0.0, 1_000 * S)
    assert hall.at(0) == []
    hall.change((APPEARED, thing("a", -1.5)), (APPEARED, thing("b", 2.5)), (APPEARED, thing("p", 0, name="pallet")))
    assert hall.at(1) == ["raised box a is 1.50 m from r1, nearer than 2 m"]
    assert [(each.robot, each.camera, each.name) for each in hall.engine.alerts()] == [("r1", "", "box")]
    assert hall.at(60) == []  # the robot's place is not known any more
    hall.change((APPEARED, thing("c", 1.0)))
    assert hall.at(60.5) == []
    hall.poses["r1"] = Pose(0.5, 1.0, 0.0, 1_061 * S)
    assert sorted(hall.at(61)) == [
        "raised box c is 0.50 m from r1, nearer than 2 m",
        "resolved box a is 1.50 m from r1, nearer than 2 m",
    ]
    hall.change((APPEARED, thing("d", 1.5)))
    assert hall.at(62) == ["raised box d is 1.00 m from r1, nearer than 2 m"]


def test_a_robot_that_another_one_sees_is_not_near_itself() -> None:
    hall = Hall(rule("near_robot", than_m=3, **{"class": "forklift"}))
    hall.poses["r1"] = Pose(0.0, 1.0, 0.0, 1_000 * S)

    def forklift(object_id: str, x: float, y: float, by: str = "r2", **more: Any) -> WorldObject:
        seen_by = [Seer(robot=by, camera="front", last_ns=1)]
        known = {"size": (2.6, 1.2, 2.1), "velocity": (0.0, 0.0), "seen_by": seen_by, **more}
        return msgspec.structs.replace(thing(object_id, x, y, name="forklift"), **known)

    upright = math.pi / 2
    itself = [
        forklift("at", 0.1, 1.0),
        forklift("long", 1.5, 1.0),
        forklift("turned", 0.1, 2.5, yaw=upright),
    ]
    others = [
        forklift("stands", 0.1, 1.0, velocity=None),
        forklift("own", 0.1, 1.0, by="r1"),
        forklift("beyond", 1.7, 1.0),
        forklift("beside", 0.1, 2.5),
        forklift("across", 1.5, 1.0, yaw=upright),
    ]
    hall.change(*((APPEARED, each) for each in (*itself, *others)))
    assert sorted(each.split()[2] for each in hall.at(0)) == sorted(each.id for each in others)
