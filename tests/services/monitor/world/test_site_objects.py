from collections import Counter
from time import time_ns

import msgspec
import pytest

from schemas.space import Vector
from schemas.world import ChangeKind, WorldChange, WorldChanges, WorldObject
from services.monitor.fleet import Fleet
from services.monitor.world.site_objects import LATEST, MAX_BUFFERED, MAX_FOLLOWED, SITE, SiteObjects, World
from services.monitor.world.site_status import FRESH_NS, Sites
from services.monitor.world.zones import Zone
from tests.services.monitor.world.test_site_status import status

DOCK = Zone(name="dock", site="hall", corners=((0, 0), (4, 0), (4, 4), (0, 4)))
RACK = Zone(name="rack", site="hall", corners=((3, 0), (8, 0), (8, 4), (3, 4)))


def thing(object_id: str, x: float, y: float = 1.0, name: str = "box") -> WorldObject:
    at: Vector = (x, y, 0.5)
    return WorldObject(
        id=object_id,
        site="hall",
        name=name,
        at=at,
        covariance=(0.01, 0, 0, 0.01, 0, 0.01),
        size=(1.0, 1.0, 1.0),
        existence=1.0,
        first_ns=1,
        last_ns=2,
    )


def change(kind: ChangeKind, of: WorldObject) -> WorldChange:
    return WorldChange(kind=kind, at_ns=1, object=of, into="other" if kind is ChangeKind.MERGED else None)


def changes(first: int, *some: WorldChange, epoch: str = "e") -> WorldChanges:
    return WorldChanges(site="hall", epoch=epoch, first=first, sent_ns=0, changes=list(some))


def tell_of(fleet: Fleet, *objects: WorldObject, site: str = "hall", for_s: int = 3_600) -> None:
    """Have a fleet know all objects of a site, whose world model counts as there for so long."""
    of_class = Counter(each.name for each in objects)
    told = msgspec.structs.replace(status(site), objects=dict(of_class))
    fleet.sites.take(told, time_ns() + for_s * 10**9)
    fleet.world.hear(told)
    fleet.world.sites[site].replace("e", 0, objects)


APPEARED, MOVED, GONE, BACK, MERGED, SEEN = (ChangeKind(kind) for kind in ChangeKind)


@pytest.fixture
def hall() -> SiteObjects:
    found = SiteObjects([DOCK, RACK])
    found.replace("e", 0, [])
    return found


def test_each_zone_counts_the_objects_in_it_as_they_come_move_and_go(hall: SiteObjects) -> None:
    hall.take(changes(1, *(change(APPEARED, thing(f"o{x}", x)) for x in (1, 2, 3.5)), change(APPEARED, thing("p", 9))))
    assert (hall.count("dock"), hall.count("rack")) == ({"box": 3}, {"box": 1})
    hall.take(changes(5, change(MOVED, thing("o1", 7)), change(SEEN, thing("o2", 2))))
    assert (hall.count("dock"), hall.count("rack")) == ({"box": 2}, {"box": 2})
    hall.take(changes(7, change(GONE, thing("o1", 7)), change(MERGED, thing("o2", 2)), change(GONE, thing("o3.5", 3))))
    assert (hall.count("dock"), hall.count("rack")) == ({"box": 0}, {"box": 0})
    hall.take(changes(10, change(BACK, thing("o1", 7, name="pallet"))))
    assert hall.count("rack") == {"box": 0, "pallet": 1}
    assert set(hall.objects) == {"p", "o1"}


def test_an_object_on_a_border_stays_in_its_zones_until_it_is_clearly_outside(hall: SiteObjects) -> None:
    hall.take(changes(1, change(APPEARED, thing("a", 4.1)), change(APPEARED, thing("b", 3.9))))
    assert [hall.objects[each].zones for each in "ab"] == [("rack",), ("dock", "rack")]
    for number, x in enumerate((4.1, 3.9, 4.005, 4.19)):
        hall.take(changes(3 + number, change(MOVED, thing("b", x))))
        assert hall.objects["b"].zones == ("dock", "rack")
    hall.transitions.clear()
    hall.take(changes(7, change(MOVED, thing("b", 4.21)), change(MOVED, thing("b", 4.1)), change(MOVED, thing("b", 4))))
    assert [(each.was_in("dock"), each.is_in("dock")) for each in hall.transitions] == [(True, False)] + 2 * [
        (False, False)
    ]
    hall.take(changes(10, change(MOVED, thing("b", 3.95)), change(MOVED, thing("b", 4.15, -0.15))))
    assert [hall.objects[each].zones for each in "ab"] == 2 * [("rack",)], "a corner is farther away than its sides"
    assert (hall.count("dock"), hall.count("rack")) == ({"box": 0}, {"box": 2})


def test_zones_that_change_shape_are_judged_anew_and_the_others_are_not(hall: SiteObjects) -> None:
    hall.take(changes(1, change(APPEARED, thing("a", 3.5)), change(MOVED, thing("a", 3.5, 4.1))))
    assert hall.count("rack") == {"box": 1}
    hall.set_zones([DOCK, RACK.model_copy(update={"corners": ((3, 0), (9, 0), (9, 4), (3, 4))})])
    assert hall.objects["a"].zones == ("dock",)


def test_an_object_of_another_class_than_before_counts_as_that(hall: SiteObjects) -> None:
    hall.take(changes(1, change(APPEARED, thing("a", 1)), change(SEEN, thing("a", 1, name="pallet"))))
    assert hall.count("dock") == {"box": 0, "pallet": 1}


def test_what_goes_twice_or_was_never_there_counts_once(hall: SiteObjects) -> None:
    hall.take(changes(1, change(APPEARED, thing("a", 1)), *[change(GONE, thing("a", 1))] * 2))
    hall.take(changes(4, change(GONE, thing("never", 1))))
    assert hall.count("dock") == {"box": 0}


def test_changes_that_came_before_are_not_applied_again(hall: SiteObjects) -> None:
    first = changes(1, change(APPEARED, thing("a", 1)), change(GONE, thing("a", 1)))
    hall.take(first)
    hall.take(first)
    hall.take(changes(2, change(GONE, thing("a", 1)), change(APPEARED, thing("b", 1))))
    assert (set(hall.objects), hall.is_behind) == ({"b"}, False)


@pytest.mark.parametrize(
    "missed", [changes(3, change(APPEARED, thing("c", 1))), changes(2, change(APPEARED, thing("c", 1)), epoch="f")]
)
def test_after_a_gap_or_in_another_epoch_all_are_asked_for_and_later_changes_wait(
    hall: SiteObjects, missed: WorldChanges
) -> None:
    hall.take(changes(1, change(APPEARED, thing("a", 1))))
    hall.take(missed)
    later = msgspec.structs.replace(missed, first=missed.first + 1, changes=[change(APPEARED, thing("d", 7))])
    hall.take(later)
    assert (hall.is_behind, set(hall.objects)) == (True, {"a"})
    hall.replace(missed.epoch, missed.first, [thing("b", 1), thing("c", 1)])
    assert (hall.is_behind, set(hall.objects)) == (False, {"b", "c", "d"})
    assert (hall.count("dock"), hall.count("rack")) == ({"box": 2}, {"box": 1})


def _went(site: SiteObjects, zone: str = "dock") -> dict[str, tuple[bool, bool]]:
    """Return whether each object with a transition was in a zone, and is."""
    return {each.object_id: (each.was_in(zone), each.is_in(zone)) for each in site.transitions}


@pytest.mark.parametrize("epoch", ["e", "f"])
def test_what_happened_while_changes_were_missed_is_in_the_transitions(hall: SiteObjects, epoch: str) -> None:
    before = [thing("stays", 1), thing("goes", 1), thing("comes", 9), thing("gone", 1), thing("edge", 3.95)]
    hall.replace("e", 1, before)
    assert not hall.transitions, "these are the first"
    hall.take(changes(2, change(MOVED, thing("earlier", 9))))
    hall.take(changes(7, change(SEEN, thing("stays", 1)), epoch=epoch))
    after = [thing("stays", 1), thing("goes", 9), thing("comes", 1), thing("new", 1), thing("edge", 4.05)]
    hall.replace(epoch, 8, [*after, thing("earlier", 9)])
    assert _went(hall) == {
        "earlier": (False, False),
        "goes": (True, False),
        "comes": (False, True),
        "gone": (True, False),
        "new": (False, True),
        "edge": (True, True),
    }


def test_nothing_entered_or_left_where_ids_began_anew(hall: SiteObjects) -> None:
    hall.replace("e", 1, [thing("a", 1)])
    hall.replace("f", 1, [thing("b", 1), thing("c", 9)])
    assert not hall.transitions
    hall.replace("f", 3, [])
    assert _went(hall) == {"b": (True, False), "c": (False, False)}


def test_what_was_merged_while_changes_were_missed_did_not_leave(hall: SiteObjects) -> None:
    hall.replace("e", 1, [thing("a", 1), thing("b", 1)])
    hall.take(changes(3, msgspec.structs.replace(change(MERGED, thing("a", 1)), into="b")))
    hall.replace("e", 3, [thing("b", 1)])
    assert not hall.transitions


def test_what_is_not_followed_any_more_as_there_are_too_many_did_not_leave() -> None:
    hall = SiteObjects([DOCK], most=2)
    hall.replace("e", 0, [thing("a", 1), thing("b", 1)])
    hall.replace("e", 9, [thing("c", 1), thing("b", 9), thing("a", 1)])
    assert _went(hall) == {"b": (True, False)}


def test_an_answer_that_is_older_than_what_was_missed_is_not_enough(hall: SiteObjects) -> None:
    hall.take(changes(5, change(APPEARED, thing("a", 1))))
    hall.replace("e", 2, [])
    assert hall.is_behind
    hall.replace("e", 4, [])
    assert (hall.is_behind, set(hall.objects)) == (False, {"a"})


def test_what_waits_is_limited(hall: SiteObjects) -> None:
    for number in range(MAX_BUFFERED + 1):
        hall.take(changes(number + 2, change(APPEARED, thing(f"o{number}", 1))))
    hall.replace("e", 1, [])
    assert hall.is_behind


def test_changes_that_a_status_told_of_and_that_never_came_are_noticed_at_the_next(hall: SiteObjects) -> None:
    told = msgspec.structs.replace(status("hall"), last=1)
    hall.hear(told)
    assert not hall.is_behind
    hall.hear(told)
    assert hall.is_behind
    hall.replace("e", 1, [thing("a", 1)])
    hall.hear(told)
    assert not hall.is_behind
    hall.hear(msgspec.structs.replace(told, epoch="f"))
    assert hall.is_behind


def test_changes_of_somebody_else_in_the_models_name_are_noticed_a_few_statuses_later(hall: SiteObjects) -> None:
    told = msgspec.structs.replace(status("hall"), epoch="e")
    hall.take(changes(1, change(ChangeKind.APPEARED, thing("1", 1))))
    hall.hear(msgspec.structs.replace(told, last=1))
    forged = [change(ChangeKind.APPEARED, thing(f"forged {number}", 1)) for number in range(100)]
    hall.take(changes(2, *forged))
    hall.take(changes(2, change(ChangeKind.APPEARED, thing("2", 1))))
    for _ in range(LATEST):
        hall.hear(msgspec.structs.replace(told, last=2))
        assert not hall.is_behind, "changes may overtake statuses"
    hall.hear(msgspec.structs.replace(told, last=2))
    assert hall.is_behind
    hall.replace("e", 2, [thing("1", 1), thing("2", 1)])
    hall.hear(msgspec.structs.replace(told, last=2))
    hall.take(changes(3, change(ChangeKind.APPEARED, thing("3", 1))))
    hall.hear(msgspec.structs.replace(told, last=3))
    assert not hall.is_behind
    assert sorted(hall.objects) == ["1", "2", "3"]


def test_what_happened_is_handed_out_once_also_what_the_answer_with_all_objects_has_in_it(hall: SiteObjects) -> None:
    hall.take(changes(1, change(APPEARED, thing("a", 1)), change(SEEN, thing("a", 1)), change(MOVED, thing("a", 7))))
    assert [(each.kind, each.object.id) for each in hall.take_events()] == [(APPEARED, "a"), (MOVED, "a")]
    assert hall.take_events() == []
    hall.take(changes(9, *(change(kind, thing("b", 1)) for kind in (APPEARED, MOVED, GONE))))
    assert hall.take_events() == []
    hall.replace("e", 10, [thing("b", 1)])
    assert [each.kind for each in hall.take_events()] == [APPEARED, GONE]
    assert hall.objects == {}


def test_all_of_a_site_is_counted_and_its_version_grows_with_every_change(hall: SiteObjects) -> None:
    before = hall.version
    hall.take(changes(1, change(APPEARED, thing("a", 1)), change(APPEARED, thing("far", 90))))
    assert (hall.count(SITE), hall.count("dock")) == ({"box": 2}, {"box": 1})
    assert hall.version == before + 2
    newer = msgspec.structs.replace(thing("a", 1), last_ns=9)
    hall.take(changes(3, change(SEEN, newer)))
    assert (hall.objects["a"].of.last_ns, hall.objects["a"].zones, hall.version) == (9, ("dock",), before + 3)
    hall.take(changes(4, change(GONE, newer)))
    assert (hall.count(SITE), hall.version) == ({"box": 1}, before + 4)


def test_sites_are_followed_as_they_are_told_of_up_to_a_limit() -> None:
    world, off = World([DOCK]), World(on=False)
    for number in range(MAX_FOLLOWED + 1):
        for each in (world, off):
            each.hear(status(f"s{number}"))
    assert len(world.sites) == MAX_FOLLOWED
    (problem,) = world.problems()
    assert problem.startswith(f"site s{MAX_FOLLOWED} is not followed, as {MAX_FOLLOWED} others are: run another")
    assert (off.sites, list(off.problems())) == ({}, [])


def test_of_too_many_objects_the_first_are_followed_and_that_is_told() -> None:
    hall = SiteObjects([DOCK], most=2)
    hall.replace("e", 0, [thing("a", 1), thing("b", 1), thing("c", 1)])
    assert (hall.count("dock"), hall.is_full) == ({"box": 2}, True)
    hall.take(changes(1, change(GONE, thing("a", 1)), change(SEEN, thing("c", 1))))
    assert (set(hall.objects), hall.count("dock")) == ({"b", "c"}, {"box": 2})


def test_zones_are_current_while_their_world_model_is_there_and_all_is_known() -> None:
    other = msgspec.structs.replace  # sites keep to themselves
    yard = DOCK.model_copy(update={"site": "yard"})
    world, sites = World([DOCK, yard, RACK]), Sites()
    assert [(each.zone.site, each.zone.name) for each in world.zones(sites, 0)] == [
        ("hall", "dock"),
        ("hall", "rack"),
        ("yard", "dock"),
    ]
    for name in ("hall", "yard", "elsewhere"):
        sites.take(status(name), 10)
        world.hear(other(status(name), epoch="e"))
    assert not any(each.current for each in world.zones(sites, 10))
    world.sites["hall"].replace("e", 0, [thing("a", 1)])
    assert [(each.current, each.objects) for each in world.zones(sites, 10)] == [
        (True, {"box": 1}),
        (True, {}),
        (False, {}),
    ]
    assert not any(each.current for each in world.zones(sites, 11 + FRESH_NS))


def test_zones_that_change_have_what_is_in_them_and_nothing_entered_or_left() -> None:
    world = World([DOCK])
    hall = world.sites["hall"]
    hall.replace("e", 0, [thing("a", 1), thing("b", 7), thing("p", 7.5, name="pallet")])
    version = hall.version
    world.set_zones([RACK, DOCK.model_copy(update={"site": "yard"})])
    assert world.sites["hall"] is hall, "who follows it goes on"
    assert [zone.name for zone in hall.zones] == ["rack"]
    assert (hall.count("rack"), hall.count(SITE)) == ({"box": 1, "pallet": 1}, {"box": 2, "pallet": 1})
    assert hall.objects["a"].zones == ()
    assert hall.version > version
    assert not hall.transitions
    assert world.sites["yard"].is_behind
    hall.take(changes(1, change(GONE, thing("b", 7))))
    assert hall.count("rack") == {"box": 0, "pallet": 1}
    version = hall.version
    world.set_zones([RACK])
    assert hall.version == version, "these zones are as before"
    assert world.sites["yard"].zones == ()
