import msgspec

from services.monitor.world.shown_site import KEPT_NS, OFF, shown_site, site_names
from services.monitor.world.site_objects import World
from services.monitor.world.site_status import FRESH_NS, Sites
from tests.services.monitor.world.test_site_objects import DOCK, thing
from tests.services.monitor.world.test_site_status import status

JOIN = "tcp/here:7447"
NOW = 10**18


def told(*names: str) -> tuple[World, Sites]:
    world, sites = World([DOCK]), Sites()
    for name in names:
        sites.take(status(name), NOW)
        world.hear(msgspec.structs.replace(status(name), epoch="e"))
        world.sites[name].replace("e", 0, [thing("a", 1)])
    return world, sites


def test_without_a_world_model_the_cure_is_said() -> None:
    world, sites = told()
    shown = shown_site(world, sites, NOW, join=JOIN)
    assert (shown.name, shown.objects, shown.current) == ("", None, False)
    assert "No world model runs" in shown.notice
    assert f"fleetsight worldmodel --connect {JOIN}" in shown.notice
    off = shown_site(World(on=False), sites, NOW, join=JOIN)
    assert (off.objects, off.notice) == (None, OFF)


def test_the_chosen_site_is_shown_else_one_whose_model_is_there() -> None:
    world, sites = told("yard", "hall")
    assert site_names(world, sites) == ["hall", "yard"]
    sites.take(status("hall"), NOW - FRESH_NS - 1)
    assert [shown_site(world, sites, NOW, chosen=each).name for each in ("", "hall", "nowhere")] == [
        "yard",
        "hall",
        "yard",
    ]
    shown = shown_site(world, sites, NOW)
    assert (shown.objects, shown.current, shown.notice) == (world.sites["yard"], True, "")


def test_objects_of_a_silent_model_are_shown_for_a_while_and_then_what_cameras_see() -> None:
    world, sites = told("hall")
    shown = shown_site(world, sites, NOW + KEPT_NS, join=JOIN)
    assert (shown.objects, shown.current) == (world.sites["hall"], False)
    assert "its objects are as they were then" in shown.notice
    shown = shown_site(world, sites, NOW + KEPT_NS + 1, join=JOIN)
    assert shown.objects is None
    assert f"start one: fleetsight worldmodel --connect {JOIN}" in shown.notice


def test_robots_without_a_map_are_told_of_with_the_cure() -> None:
    world, sites = told("hall")
    blind = msgspec.structs.replace(status("hall"), left_out={"of a robot without a map frame": 7})
    sites.take(blind, NOW)
    assert shown_site(world, sites, NOW).notice == ""  # some robot has one
    world.sites["hall"].replace("e", 0, [])
    assert "no frame map; start their localisation" in shown_site(world, sites, NOW).notice
    sites.take(status("hall"), NOW)
    assert shown_site(world, sites, NOW).notice == ""


def test_objects_that_are_asked_for_are_not_current() -> None:
    world, sites = told("hall")
    world.hear(msgspec.structs.replace(status("hall"), epoch="f"))
    shown = shown_site(world, sites, NOW)
    assert (shown.objects, shown.current) == (world.sites["hall"], False)
    assert "being asked for" in shown.notice
