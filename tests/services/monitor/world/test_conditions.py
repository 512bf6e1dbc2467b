from collections.abc import Callable
from itertools import count
from typing import Any

import msgspec
import pytest

from schemas.world import LONG_AGO, ChangeKind, RobotOffset, WorldObject
from services.monitor.map.pose import Pose
from services.monitor.rules.engine import RuleEngine
from services.monitor.rules.model import RuleBook, WorldRule
from services.monitor.world.conditions import MAX_IDS, MOST_ALERTS, WorldConditions, remarks_on_zones
from services.monitor.world.floor import floor_of
from services.monitor.world.site_objects import MAX_TRANSITIONS, World
from services.monitor.world.site_status import FRESH_NS, Sites
from services.monitor.world.zones import Zone
from tests.schemas.results import alert
from tests.services.monitor.rules.ruling import book
from tests.services.monitor.world.test_floor import looks
from tests.services.monitor.world.test_site_objects import DOCK, RACK, change, changes, thing
from tests.services.monitor.world.test_site_status import status

S = 1_000_000_000
Holds = Callable[[float], list[str]]


def rule(when: str, **more: Any) -> dict[str, Any]:
    zone = {} if when in {"moved", "near_robot"} else {"zone": "dock"}
    return {"when": when, "class": "box", "site": "hall", **zone, **more}


def of_sites(rules: RuleBook) -> list[WorldRule]:
    return [each for each in rules.rules if isinstance(each, WorldRule)]


class Hall:
    """A site with zones, the rules on it, and an engine that raises their alerts."""

    def __init__(self, *rules: dict[str, Any]) -> None:
        self.world, self.sites, self.poses = World([DOCK, RACK]), Sites(), dict[str, Pose]()
        self.objects = self.world.sites["hall"]
        self.objects.replace("e", 0, [])
        self.conditions = WorldConditions(self.world, self.sites, self.poses)
        numbers = count(1)
        self.engine = RuleEngine(book(*rules), lambda: str(next(numbers)))
        self.number = 0
        self.robots = ["r1"]

    def change(self, *some: tuple[ChangeKind, WorldObject]) -> None:
        self.objects.take(changes(self.number + 1, *(change(*each) for each in some)))
        self.number += len(some)

    def merge(self, of: WorldObject, into: str) -> None:
        merged = msgspec.structs.replace(change(ChangeKind.MERGED, of), into=into)
        self.objects.take(changes(self.number + 1, merged))
        self.number += 1

    def at(self, at_s: float, *, current: bool = True) -> list[str]:
        """Return the alerts that changed."""
        now_ns = round((at_s + 1_000) * S)
        offsets = [
            RobotOffset(robot=robot, x=0.0, y=0.0, yaw=0.0, sigma_m=0.0, views=1, last_ns=1) for robot in self.robots
        ]
        if current:
            self.sites.take(msgspec.structs.replace(status("hall"), robots=offsets), now_ns)
        for of, robot, found in self.conditions.evaluate(of_sites(self.engine.book), now_ns):
            self.engine.world(of, robot, found, now_ns)
        return [f"{each.alert.state} {each.alert.text}" for each in self.engine.due(now_ns)]


APPEARED, MOVED, GONE, BACK = ChangeKind.APPEARED, ChangeKind.MOVED, ChangeKind.GONE, ChangeKind.BACK


def test_over_and_under_a_count_in_a_zone() -> None:
    hall = Hall(rule("zone_over", count=1, for_s=5), rule("zone_under", count=2))
    assert hall.at(0) == ["raised 0 box in hall/dock, under 2"]
    hall.change((APPEARED, thing("a", 1)), (APPEARED, thing("b", 1)), (APPEARED, thing("c", 9)))
    assert hall.at(1) == ["resolved 0 box in hall/dock, under 2"]
    assert hall.at(5) == []
    assert hall.at(6) == ["raised 2 box in hall/dock, over 1"]
    hall.change((MOVED, thing("a", 9)))
    assert sorted(hall.at(7)) == ["raised 1 box in hall/dock, under 2", "resolved 2 box in hall/dock, over 1"]


def test_what_was_in_a_zone_at_the_beginning_did_not_enter_it() -> None:
    hall = Hall(rule("enters"))
    hall.objects.replace("e", 0, [thing("a", 1)])
    assert hall.at(0) == []
    hall.change((APPEARED, thing("p", 1, name="pallet")), (APPEARED, thing("b", 9)), (MOVED, thing("b", 2)))
    assert hall.at(1) == ["raised box b entered hall/dock"]
    hall.change((MOVED, thing("b", 3)))
    assert hall.at(100) == []
    hall.change((MOVED, thing("b", 9)))
    assert hall.at(101) == ["resolved box b entered hall/dock"]
    hall.change((APPEARED, thing("c", 1)))
    assert hall.at(102) == ["raised box c entered hall/dock"]
    hall.change((GONE, thing("c", 1)))
    assert hall.at(103) == ["resolved box c entered hall/dock"]


def test_what_entered_and_left_while_changes_were_missed_is_told() -> None:
    hall = Hall(rule("enters"), rule("leaves"))
    hall.objects.replace("e", 0, [thing("a", 1), thing("b", 9)])
    assert hall.at(0) == []
    hall.objects.take(changes(4, change(MOVED, thing("b", 1))))
    hall.change((MOVED, thing("a", 9)))
    assert hall.at(1) == [], "it is not known yet"
    hall.objects.replace("e", 4, [thing("a", 9), thing("b", 1)])
    assert sorted(hall.at(2)) == ["raised box a left hall/dock", "raised box b entered hall/dock"]


def test_what_left_a_zone_is_told_for_a_while_unless_it_is_back() -> None:
    hall = Hall(rule("leaves", within_s=10))
    hall.objects.replace("e", 0, [thing("a", 1), thing("b", 1)])
    hall.at(0)
    hall.change((MOVED, thing("a", 9)))
    assert hall.at(1) == ["raised box a left hall/dock"]
    hall.change((MOVED, thing("a", 1)))
    assert hall.at(2) == ["resolved box a left hall/dock"]
    hall.change((GONE, thing("b", 1)))
    assert hall.at(3) == ["raised box b left hall/dock"]
    assert hall.at(12) == []
    assert hall.at(13) == ["resolved box b left hall/dock"]


def test_what_moved_far_enough_is_told_also_if_it_did_in_small_steps() -> None:
    hall = Hall(rule("moved", than_m=1, within_s=10), rule("moved", zone="rack", than_m=1))
    hall.objects.replace("e", 0, [thing("a", 1)])
    hall.at(0)
    for step in range(1, 5):
        hall.change((MOVED, thing("a", 1 + 0.2 * step)))
        assert hall.at(step) == []
    hall.change((MOVED, thing("a", 2.1)), (APPEARED, thing("b", 1)), (GONE, thing("b", 1)))
    assert hall.at(5) == ["raised box a moved in hall"]
    assert hall.at(15) == ["resolved box a moved in hall"]
    hall.change((MOVED, thing("a", 7)))
    assert sorted(hall.at(16)) == ["raised box a moved in hall", "raised box a moved in hall/rack"]


def test_one_object_that_is_missing_from_its_zone_is_elsewhere_or_gone() -> None:
    hall = Hall(rule("missing", object="a"))
    hall.objects.replace("e", 0, [thing("a", 1), thing("b", 1)])
    assert hall.at(0) == []
    hall.change((GONE, thing("b", 1)), (MOVED, thing("a", 9)))
    assert hall.at(1) == ["raised box a is missing from hall/dock: it is at 9.0, 1.0 m"]
    hall.change((GONE, thing("a", 9)), (BACK, thing("a", 1)))
    assert [each.split()[0] for each in hall.at(2)] == ["resolved"]
    hall.change((GONE, thing("a", 1)))
    assert hall.at(3) == ["raised box a is missing from hall/dock: it is gone"]


def test_an_object_that_was_merged_did_not_leave_the_zones_of_the_one_that_it_became() -> None:
    hall = Hall(rule("leaves", within_s=10), rule("leaves", zone="rack", within_s=10))
    hall.objects.replace("e", 0, [thing("a", 3.5), thing("b", 1), thing("c", 1), thing("d", 9)])
    hall.at(0)
    hall.merge(thing("a", 3.5), into="b")
    assert hall.at(1) == ["raised box a left hall/rack"]
    hall.merge(thing("b", 1), into="c")
    assert hall.at(2) == []
    hall.merge(thing("c", 1), into="d")
    assert hall.at(3) == ["raised box c left hall/dock"]


def test_an_object_that_left_its_zone_and_was_merged_into_one_there_is_back() -> None:
    hall = Hall(rule("leaves"))
    hall.objects.replace("e", 0, [thing("a", 1), thing("b", 1)])
    hall.at(0)
    hall.change((MOVED, thing("a", 5)))
    assert hall.at(1) == ["raised box a left hall/dock"]
    hall.merge(thing("a", 5), into="b")
    assert hall.at(2) == ["resolved box a left hall/dock"]


def test_what_was_merged_into_an_object_in_its_zone_is_not_missing() -> None:
    hall = Hall(rule("missing", object="a"))
    hall.objects.replace("e", 0, [thing("a", 1), thing("b", 1), thing("c", 1)])
    assert hall.at(0) == []
    hall.merge(thing("a", 1), into="b")
    hall.merge(thing("b", 1), into="c")
    assert hall.at(1) == []
    hall.change((MOVED, thing("c", 9)))
    assert hall.at(2) == ["raised box a is missing from hall/dock: it is at 9.0, 1.0 m"]
    hall.merge(thing("c", 9), into="a")  # a circle, which no model tells of
    assert hall.at(3) == []


@pytest.mark.parametrize("why", ["behind", "stale"])
def test_while_a_site_is_not_known_nothing_is_raised_or_resolved(why: str) -> None:
    hall = Hall(rule("zone_over", count=0), rule("zone_under", count=1))
    assert hall.at(0) == ["raised 0 box in hall/dock, under 1"]
    hall.change((APPEARED, thing("a", 1)))
    hall.objects.is_behind = why == "behind"
    late_s = 1 + 2 * FRESH_NS / S
    assert hall.at(late_s, current=why == "behind") == []
    hall.objects.is_behind = False
    assert len(hall.at(late_s + 1)) == 2


def test_a_rule_that_holds_for_several_objects_raises_an_alert_for_each() -> None:
    hall = Hall(rule("enters", cooldown_s=60))
    hall.at(0)
    hall.change((APPEARED, thing("a", 1)), (APPEARED, thing("b", 1)))
    assert sorted(hall.at(1)) == ["raised box a entered hall/dock", "raised box b entered hall/dock"]
    alerts = {each.object: each for each in hall.engine.alerts()}
    assert {(each.site, each.name, each.link) for each in alerts.values()} == {
        ("hall", "box", "/world/hall/a"),
        ("hall", "box", "/world/hall/b"),
    }
    hall.engine.acknowledge(alerts["a"].id, 1_001 * S)
    hall.change((MOVED, thing("b", 9)), (APPEARED, thing("c", 1)))
    assert sorted(hall.at(2)) == [
        "acknowledged box a entered hall/dock",
        "raised box c entered hall/dock",
        "resolved box b entered hall/dock",
    ]
    hall.change((MOVED, thing("b", 1)))
    assert hall.at(3) == []  # its cooldown, which is no other's
    assert hall.at(61) == ["raised box b entered hall/dock"]


def test_an_alert_of_an_earlier_monitor_about_what_entered_ends_when_that_object_is_not_there_any_more() -> None:
    before = Hall(rule("enters"))
    before.at(0)
    before.change((APPEARED, thing("a", 1)), (APPEARED, thing("b", 1)))
    before.at(1)
    hall = Hall(rule("enters"))
    hall.objects.replace("e", 0, [thing("a", 1), thing("c", 1)])
    hall.engine.restore(before.engine.alerts(), 1_002 * S)
    hall.conditions.adopt(hall.engine.alerts())
    assert hall.at(2) == ["resolved box b entered hall/dock"]
    hall.change((MOVED, thing("a", 9)))
    assert hall.at(3) == ["resolved box a entered hall/dock"]


def test_an_alert_without_an_object_of_an_earlier_release_is_resolved() -> None:
    hall = Hall(rule("enters"))
    old = msgspec.structs.replace(alert(), rule="rule 0", robot="", camera="", name="box")
    hall.engine.restore([old], 1_000 * S)
    assert hall.at(0) == [f"resolved {old.text}"]


def test_what_happened_before_a_monitor_leads_or_a_rule_is_in_force_does_not_count() -> None:
    hall = Hall(rule("enters"), rule("leaves"))
    hall.at(0)
    hall.change((APPEARED, thing("a", 1)))
    hall.conditions.begin()
    assert hall.at(1) == []
    hall.change((APPEARED, thing("b", 1)), (GONE, thing("b", 1)))
    assert hall.at(2) == ["raised box b left hall/dock"]
    hall.engine.replace(book(), 1_003 * S)
    hall.change((APPEARED, thing("c", 1)))
    hall.at(3)
    hall.engine.replace(book(rule("enters")), 1_004 * S)
    assert hall.at(4) == []


def test_a_zone_that_is_not_there_says_nothing_and_is_remarked_on() -> None:
    hall = Hall(rule("zone_under", count=1, zone="dok"), rule("near_robot", than_m=1, site="yard"), rule("moved"))
    assert hall.at(0) == []
    assert list(remarks_on_zones(of_sites(hall.engine.book), hall.world)) == [
        "rule 'rule 0': site hall has no zone 'dok'",
        "rule 'rule 1': site yard is not followed: no world model has told of it",
    ]


def test_a_zone_that_nobody_looked_at_for_long_and_one_of_which_nothing_is_known() -> None:
    hall = Hall({"when": "unseen", "site": "hall", "zone": "dock", "than_s": 60})
    assert hall.at(0) == []
    assert hall.objects.floor_wanted == {"dock"}
    hall.objects.floor = floor_of([DOCK], looks([[10] * 4] * 4), 1_000 * S)
    assert hall.at(1) == []
    hall.objects.floor = floor_of([DOCK], looks([[10] * 4, [70] * 4, [65_535] * 4, [55] * 4]), 1_010 * S)
    assert hall.at(10) == []
    assert hall.at(16) == ["raised 25% of hall/dock was looked at during the last 60 s"]
    assert hall.at(100) == []  # the floor was not told for long
    hall.objects.floor = floor_of([DOCK], looks([[10] * 4] * 4), 1_101 * S)
    assert hall.at(101) == ["resolved 25% of hall/dock was looked at during the last 60 s"]


def test_looks_that_a_worker_told_of_count_though_the_next_one_knows_of_none() -> None:
    hall = Hall({"when": "unseen", "site": "hall", "zone": "dock", "than_s": 60})
    hall.objects.floor = floor_of([DOCK], looks([[10] * 4] * 4), 1_000 * S)
    assert hall.at(1) == []
    nothing = looks([[LONG_AGO] * 4] * 4)
    for at_s in (10, 30, 49):
        hall.objects.floor = floor_of([DOCK], nothing, (1_000 + at_s) * S, hall.objects.floor)
        assert hall.at(at_s) == []
    newer = looks([[3] * 4] * 2 + [[LONG_AGO] * 4] * 2)
    hall.objects.floor = floor_of([DOCK], newer, 1_050 * S, hall.objects.floor)
    assert hall.at(55) == []
    hall.objects.floor = floor_of([DOCK], nothing, 1_111 * S, hall.objects.floor)
    assert hall.at(111) == ["raised 0% of hall/dock was looked at during the last 60 s"]
    hall.world.set_zones([DOCK, Zone(name="other", site="hall", corners=RACK.corners)])
    assert set(hall.objects.floor) == {"dock"}, "it is as it was"
    hall.world.set_zones([Zone(name="dock", site="hall", corners=RACK.corners)])
    assert not hall.objects.floor


def test_what_is_remembered_is_limited() -> None:
    hall = Hall(rule("leaves", within_s=1_000, for_s=4))
    assert MAX_TRANSITIONS <= MAX_IDS
    hall.at(0)
    for round_ in range(2):
        names = [f"o{round_}-{each}" for each in range(MAX_IDS)]
        hall.change(*((APPEARED, thing(name, 1)) for name in names))
        hall.at(3 * round_ + 1)
        hall.change(*((GONE, thing(name, 1)) for name in names))
        hall.at(3 * round_ + 2)
    told = hall.at(10)
    assert len(told) == MOST_ALERTS
    assert "raised box o1-9999 left hall/dock" in told
    assert list(hall.conditions.problems()) == ["rule 'rule 0' holds for 10,000 objects; 100 of them have alerts"]
    hall.at(1_010)
    assert list(hall.conditions.problems()) == []


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (rule("zone_over", count=1, robots=["r1"]), "takes no `robots`"),
        (rule("near_robot", than_m=1, cameras=["front"]), "takes no `cameras`"),
        (rule("enters", action={"name": "stop"}), "an action needs a robot"),
        ({"when": "enters", "class": "box"}, "zone"),
        (rule("near_robot", than_m=21), "20"),
    ],
)
def test_a_rule_that_makes_no_sense_is_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        book(given)
