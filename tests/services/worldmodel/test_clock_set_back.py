"""A site whose machine's clock was set back by an hour."""

import logging
import time

import pytest

from bus.fake import FakeNetwork
from services.worldmodel.floor import Floor
from services.worldmodel.name_limits import ABSENT_NS, NameLimit
from services.worldmodel.settings import WorldSettings
from services.worldmodel.site import Site
from tests.services.worldmodel.scene import NS, Camera, Thing, view, watch

HOUR_NS = 3_600 * NS
BOX = Thing(4.0, 0.0)


async def test_a_clock_that_goes_back_a_little_is_no_news_and_by_an_hour_all_times_follow(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with FakeNetwork().open_bus() as bus:
        site = Site(bus, WorldSettings(), "main")
        watch(site.model, [BOX], [Camera()], 3_600.0, 10)
        newest_ns = int(site.model.objects.last_ns.max())
        with caplog.at_level(logging.WARNING):
            site._heed_clock(2 * HOUR_NS)
            site._heed_clock(2 * HOUR_NS - NS // 2)
            assert int(site.model.objects.last_ns.max()) == newest_ns
            assert caplog.messages == []
            site._heed_clock(2 * HOUR_NS - NS // 2 - HOUR_NS - 60 * NS)
        assert caplog.messages == ["the clock was set back by 3660 s"]
        assert int(site.model.objects.last_ns.max()) == HOUR_NS - 60 * NS - NS // 2


async def test_a_state_of_a_clock_that_was_ahead_is_taken_as_of_now() -> None:
    ahead_s = time.time() + 7_200
    async with FakeNetwork().open_bus() as bus:
        before = Site(bus, WorldSettings(), "main")
        watch(before.model, [BOX], [Camera()], ahead_s, 10)
        assert int(before.model.objects.last_ns.max()) > time.time_ns()
        after = Site(bus, WorldSettings(), "main", before.state())
    assert 0 < int(after.model.objects.last_ns.max()) <= time.time_ns()


def test_the_floor_is_looked_at_from_then_on() -> None:
    floor = Floor()
    floor.take(view([], Camera(), 3_600.0), HOUR_NS)
    floor.set_back(5 * NS)
    floor.take(view([], Camera(100.0, 0.0), 6.0), 6 * NS)
    message = floor.message("main", 7 * NS)
    ages = memoryview(bytes(message.ages)).cast("H").tolist()
    assert {each for each in ages if each < 65_535} == {1, 2}


def test_robots_that_are_absent_from_then_on_make_room() -> None:
    name_limit = NameLimit(most_robots=1)
    assert name_limit.admit("r1", "front", HOUR_NS) == ""
    name_limit.set_back(5 * NS)
    assert name_limit.admit("r2", "front", 6 * NS + ABSENT_NS) == ""
    assert name_limit.take_left() == (["r1"], [("r1", "front")])
