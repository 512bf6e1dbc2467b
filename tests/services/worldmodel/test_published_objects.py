"""What others get of a model: answers, what is near, how the floor was looked at, and its state over a restart."""

import numpy as np
import pytest

from bus import Sample
from bus.fake import FakeNetwork
from schemas import codec
from schemas.distances import CameraView
from schemas.world import MAX_CELLS, WorldRequest
from services.worldmodel.floor import BLOCK, CELL_M, EVERY_NS, MOST_BLOCKS, Floor
from services.worldmodel.model import SiteModel
from services.worldmodel.name_limits import NameLimit
from services.worldmodel.published_objects import PublishedObjects, inside
from services.worldmodel.settings import WorldSettings
from services.worldmodel.site import REPLACED, Site, ViewReader
from services.worldmodel.state import StateError, restored, saved
from tests.services.worldmodel.scene import NS, Camera, Thing, known, view, watch

THINGS = [Thing(3.0, 0.8), Thing(4.0, -0.9), Thing(4.2, 0.5, (1.2, 0.8, 0.14), name="pallet")]
NOW_NS = 10 * NS
ENCODING = codec.encoding(CameraView)


def seen() -> PublishedObjects:
    model = SiteModel()
    watch(model, THINGS, [Camera(robot="r1"), Camera(0.5, 0.0, robot="r2")], 1.0, 6)
    watch(model, THINGS[:1], [Camera(0.5, 0.8, robot="r3")], 5.0, 2)
    return PublishedObjects("hall-2", "a1", model)


def names(published: PublishedObjects, asked: WorldRequest) -> list[str]:
    return [each.name for each in published.matching(asked, NOW_NS)[0]]


def test_objects_are_found_by_class_region_robot_and_age() -> None:
    published = seen()
    assert names(published, WorldRequest()) == ["box", "box", "pallet"]
    assert names(published, WorldRequest(name="pallet")) == ["pallet"]
    assert names(published, WorldRequest(name="drum")) == []
    assert names(published, WorldRequest(region=[(2, 0), (3.5, 0), (3.5, 2), (2, 2)])) == ["box"]
    assert names(published, WorldRequest(robot="r3")) == ["box"]
    assert names(published, WorldRequest(seen_within_s=5.0)) == ["box"]
    assert names(published, WorldRequest(unseen_for_s=5.0)) == ["box", "pallet"]
    assert names(published, WorldRequest(least_existence=1.0)) == []


def test_an_object_says_where_it_is_and_who_saw_it() -> None:
    published = seen()
    ((box,), whole) = published.matching(WorldRequest(robot="r3"), NOW_NS)
    assert whole
    assert (box.id.startswith("a1-"), box.site, box.velocity) == (True, "hall-2", None)
    assert box.at == pytest.approx((3.0, 0.8, 0.2), abs=0.06)
    assert [seer.robot for seer in box.seen_by] == ["r3", "r2", "r1"]
    assert box.last_ns > box.first_ns == NS
    assert box.existence > 0.9


def test_what_is_near_a_robot_is_told_nearest_first() -> None:
    published = seen()
    near = published.nearby("r1", 3.5, 0)
    assert [each.name for each in near] == ["box"]
    assert len(published.nearby("r1", 8.0, 0)) == 3
    assert published.nearby("r1", 8.0, NOW_NS) == []
    assert published.nearby("nobody", 8.0, 0) == []


def test_a_robot_that_others_see_is_no_obstacle_to_itself() -> None:
    published = seen()
    truck = Thing(5.5, 0.0, (2.0, 1.2, 2.0), name="forklift")
    watch(published.model, [*THINGS, truck], [Camera(robot="r1"), Camera(0.5, 0.0, robot="r2")], 6.0, 8)
    watch(published.model, [], [Camera(5.5, 0.0, robot="r4"), Camera(4.2, 0.5, robot="r5")], 10.0, 1)
    every = ["box", "box", "forklift", "pallet"]
    assert sorted(each.name for each in published.nearby("r1", 8.0, 0)) == every
    assert sorted(each.name for each in published.nearby("r4", 8.0, 0)) == ["box", "box", "pallet"]
    assert sorted(each.name for each in published.nearby("r5", 8.0, 0)) == every  # it is over a pallet, and no pallet


def test_what_was_seen_is_told_again_but_not_at_once() -> None:
    published = seen()
    assert published.refreshed(6 * NS, 10 * NS) == []
    assert len(published.refreshed(20 * NS, 10 * NS)) == 3
    assert published.refreshed(21 * NS, 10 * NS) == []


def test_a_model_goes_on_after_a_restart_with_the_same_ids() -> None:
    published = seen()
    data = saved("hall-2", "a1", 7, published.model)
    again = SiteModel()
    assert restored("hall-2", data, again) == ("a1", 7)
    after = PublishedObjects("hall-2", "a1", again).matching(WorldRequest(), NOW_NS)[0]
    assert after == published.matching(WorldRequest(), NOW_NS)[0]
    assert "appeared" not in watch(again, THINGS, [Camera(robot="r4")], 12.0, 6)
    assert len(known(again)) == len(THINGS)
    watch(again, [*THINGS, Thing(3.0, -0.6)], [Camera(robot="r4")], 16.0, 6)
    assert len({each.id for each in PublishedObjects("hall-2", "a1", again).matching(WorldRequest(), NOW_NS)[0]}) == 4


def test_runs_that_go_on_from_one_state_give_no_id_that_another_one_gave() -> None:
    first = seen().model
    data = saved("hall-2", "a1", 7, first)
    second, third = SiteModel(), SiteModel()
    for run, each in enumerate((second, third)):
        restored("hall-2", data, each, run)
    ids = []
    for model, new in ((first, Thing(3.0, -0.6)), (second, Thing(3.4, -0.2)), (third, Thing(3.4, -0.2))):
        watch(model, [*THINGS, new], [Camera(robot="r4")], 16.0, 6)
        ids.append({each.id for each in PublishedObjects("hall-2", "a1", model).matching(WorldRequest(), NOW_NS)[0]})
    assert [len(each) for each in ids] == [len(THINGS) + 1] * 3
    old = set.intersection(*ids)
    assert len(old) == len(THINGS)
    assert len(set.union(*ids) - old) == 3


async def test_sites_that_go_on_from_one_state_go_on_with_different_numbers() -> None:
    data = saved("main", "a1", 7, seen().model)
    async with FakeNetwork().open_bus() as bus:
        sites = [Site(bus, WorldSettings(), "main", data) for _ in range(3)]
    assert len({each.model.lifecycle.next_number for each in sites}) > 1


@pytest.mark.parametrize("data", [b"", b"\x80", saved("hall-3", "a1", 7, SiteModel())], ids=["empty", "other", "site"])
def test_what_is_no_state_of_the_site_is_refused(data: bytes) -> None:
    with pytest.raises(StateError):
        restored("hall-2", data, SiteModel())


def test_points_are_in_a_polygon_or_not() -> None:
    corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 0.5), (0.0, 2.0)]
    points = np.array([(0.5, 0.5), (1.0, 1.5), (1.9, 1.0), (3.0, 1.0), (-1.0, 0.0)])
    assert inside(points, corners).tolist() == [True, False, True, False, False]


def test_the_floor_that_was_looked_at_is_as_old_as_the_look() -> None:
    floor = Floor()
    floor.take(view([], Camera(), 5.0), 5 * NS)
    said = floor.message("hall-2", 25 * NS)
    ages = np.frombuffer(said.ages, "<u2").reshape(said.rows, said.columns)
    column, row = int(4.0 - said.origin[0]), int(0.0 - said.origin[1])
    assert ages[row, column] == 20
    assert ages[row, int(-3.0 - said.origin[0])] == 65_535
    floor.take(view([], Camera(100.0, 0.0), 6.0), 5 * NS + EVERY_NS)
    grown = floor.message("hall-2", 25 * NS)
    assert grown.columns > said.columns


def test_floor_far_away_leaves_room_for_the_floor_that_there_is() -> None:
    floor, elsewhere = Floor(), Camera(30_000.0, 0.0)
    floor.take(view([], elsewhere, 1.0), NS)
    assert floor.message("hall-2", 2 * NS).origin[0] > 29_000
    for step in range(4):
        floor.take(view([], Camera(15.0 * step, 0.0), 2.0), 3 * NS + step * EVERY_NS)
    said = floor.message("hall-2", 25 * NS)
    assert said.columns * said.rows <= MAX_CELLS
    ages = np.frombuffer(said.ages, "<u2").reshape(said.rows, said.columns)
    for step in range(4):
        assert ages[int(0.0 - said.origin[1]), int(15.0 * step + 4.0 - said.origin[0])] == 22 - 2 * step


def test_of_too_much_floor_the_one_looked_at_longest_ago_is_forgotten() -> None:
    floor, wide = Floor(), BLOCK * CELL_M
    for number in range(MOST_BLOCKS + 1):
        floor.take(view([], Camera(wide * (number + 0.2), wide / 2), 1.0), NS + number * EVERY_NS)
    said = floor.message("hall-2", NS + MOST_BLOCKS * EVERY_NS)
    assert (said.origin, said.rows, said.columns) == ((wide, 0.0), BLOCK, MOST_BLOCKS * BLOCK)


def test_sites_are_given_with_their_robots() -> None:
    assert WorldSettings().robots_of == {"main": ()}
    assert WorldSettings(sites=["hall-2=r1+r2", "hall-3=*"]).robots_of == {"hall-2": ("r1", "r2"), "hall-3": ()}
    for wrong in (["a/b=r1"], ["hall=r/1"], ["hall=r1", "hall=r2"], []):
        with pytest.raises(ValueError, match="site"):
            WorldSettings(sites=wrong)
    for twice, said in (
        (["hall-2=r1+r2", "hall-3=r3+r1"], "robot r1 is given 2 times"),
        (["hall-2=r1+r1"], "robot r1 is given 2 times"),
        (["main=*", "hall-2"], "every robot is given 2 times"),
    ):
        with pytest.raises(ValueError, match=said):
            WorldSettings(sites=twice)


def test_a_robot_that_a_site_names_is_in_no_other_one() -> None:
    settings = WorldSettings(sites=["main=*", "hall-2=r1+r2", "hall-3=r3"])
    assert settings.elsewhere("main") == {"r1", "r2", "r3"}
    assert settings.elsewhere("hall-3") == {"r1", "r2"}
    name_limit = NameLimit()
    reader = ViewReader("map", name_limit, settings.elsewhere("main"))
    samples = [
        Sample(f"fleet/{robot}/front/view", codec.encode(view([], Camera(robot=robot), 1.0)), ENCODING, NS, replaced=1)
        for robot in ("r1", "r4")
    ]
    assert [each.header.robot for each, _ in reader.read(samples)] == ["r4"]
    assert dict(reader.left_out.items()) == {("r4", REPLACED): 1}
