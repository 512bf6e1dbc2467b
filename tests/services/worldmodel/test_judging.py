"""Which robots are doubted, and what they may remove: the lost, those without depth, those that just started."""

from dataclasses import replace
from functools import partial

import msgspec
import numpy as np
import pytest

from schemas.distances import CameraView
from services.worldmodel import model as model_module
from services.worldmodel import offsets as offsets_module
from services.worldmodel.model import SiteModel
from services.worldmodel.offsets import ALONE_VIEWS_TO_TRUST, CHANGED_VIEWS, LOST, REASONS, RIGHT, WRONG_DEPTH
from services.worldmodel.state import restored, saved
from tests.services.worldmodel.scene import (
    FOUR,
    KNOWN_S,
    NS,
    TWO,
    Camera,
    Thing,
    are_at,
    doubted,
    knowing,
    known,
    look_on,
    moved,
    view,
    watch,
    without_depth,
)

THREE = FOUR[:3]


def higher(seen: CameraView, by_m: float) -> CameraView:
    """Return a view in a map whose zero is lower by so much."""
    assert seen.position is not None
    x, y, z = seen.position
    objects = [
        msgspec.structs.replace(
            each, at=(each.at[0], each.at[1], each.at[2] + by_m), low_m=each.low_m + by_m, high_m=each.high_m + by_m
        )
        for each in seen.objects
    ]
    return msgspec.structs.replace(seen, position=(x, y, z + by_m), objects=objects)


def with_low_part(seen: CameraView, depth_mm: int) -> CameraView:
    """Return a view whose lower third is so far away."""
    assert seen.grid is not None
    grid = seen.grid
    changed = []
    for each in (grid.near_mm, grid.far_mm):
        cells = np.frombuffer(each, "<u2").reshape(grid.rows, grid.columns).copy()
        cells[2 * grid.rows // 3 :] = depth_mm
        changed.append(memoryview(cells.tobytes()))
    return msgspec.structs.replace(seen, grid=msgspec.structs.replace(grid, near_mm=changed[0], far_mm=changed[1]))


@pytest.mark.parametrize(
    "off",
    [(0.0, 0.9, 0.4), (0.0, 1.5, 0.0), (0.0, -1.5, 0.0), (1.5, 0.0, 0.0), (-1.5, 0.0, 0.0), (0.0, 0.0, 0.4)],
    ids=str,
)
def test_a_lost_robot_spoils_nothing_where_little_is_known(off: tuple[float, float, float]) -> None:
    model = knowing(TWO)
    before = known(model)
    assert look_on(model, TWO, Camera(robot="r2", off=off), 40) == []
    assert doubted(model, "r2") == LOST
    assert known(model) == before
    assert model.left_out["r2", model_module.DOUBTED] > 0


def test_a_lost_robot_spoils_nothing_that_others_see_at_that_time() -> None:
    model = knowing(TWO)
    assert watch(model, TWO, [Camera(), Camera(robot="r2", off=(0.0, 1.5, 0.0))], KNOWN_S, 40) == []
    assert len(known(model)) == len(TWO)
    assert (doubted(model, "r1"), doubted(model, "r2")) == (RIGHT, LOST)


def test_a_lost_robot_that_sees_nothing_any_more_removes_nothing() -> None:
    model = knowing(TWO)
    before = known(model)
    look_on(model, TWO, Camera(robot="r2", off=(0.0, 1.5, 0.0)), 3)
    assert look_on(model, [], Camera(robot="r2"), 2 * ALONE_VIEWS_TO_TRUST, start_s=KNOWN_S + 2) == []
    assert (doubted(model, "r2"), known(model)) == (LOST, before)


def test_a_lost_robot_is_trusted_again_when_what_little_it_sees_fits() -> None:
    model = knowing(TWO)
    lost = Camera(robot="r2", off=(0.0, 0.9, 0.4))
    look_on(model, TWO, lost, 6)
    look_on(model, TWO, replace(lost, off=(0.0, 0.0, 0.0)), 4, start_s=16.0)
    assert doubted(model, "r2") == LOST
    look_on(model, TWO, replace(lost, off=(0.0, 0.0, 0.0)), 1, start_s=18.0)
    assert doubted(model, "r2") == RIGHT


@pytest.mark.parametrize("start_s", [KNOWN_S, 60.0])
@pytest.mark.parametrize("robot", ["r1", "r2"])
def test_a_robot_just_started_is_not_lost_where_its_detector_misses_one_thing_and_another_is_new(
    robot: str, start_s: float
) -> None:
    model = knowing(TWO[:1])
    camera, new = Camera(robot=robot), Thing(3.2, -0.6)
    for step in range(60):
        at_s = start_s + step / 2
        model.take(view([*TWO[:1], new], camera, at_s, blind_to=[0]), round(at_s * NS))
        assert doubted(model, robot) == RIGHT, step
    assert are_at(known(model), [new, *TWO[:1]])


def test_things_that_cameras_of_a_robot_just_started_see_together_count_as_what_one_sees() -> None:
    turns = [number * np.pi / 2 for number in range(4)]
    things = [Thing(3.5 * float(np.cos(each)), 3.5 * float(np.sin(each))) for each in turns]
    others = [Thing(each.x - 0.35 * each.y, each.y + 0.35 * each.x) for each in things]
    model = SiteModel()
    watch(model, things, [Camera(yaw=each, name=f"c{each}") for each in turns], 1.0, 20)
    assert len(known(model)) == len(things)
    cameras = [Camera(robot="r2", yaw=each, name=f"c{each}") for each in turns]
    for step in range(40):
        watch(model, others, cameras, KNOWN_S + step / 2, 1)
        assert doubted(model, "r2") == RIGHT, step


def test_a_lost_robot_that_stands_still_stays_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offsets_module, "CHANGED_VIEWS", CHANGED_VIEWS // 10)
    model = knowing(TWO)
    before = known(model)
    assert look_on(model, TWO, Camera(robot="r2", off=(0.0, 1.5, 0.0)), 2 * CHANGED_VIEWS // 10, start_s=60.0) == []
    assert (doubted(model, "r2"), known(model)) == (LOST, before)


@pytest.mark.parametrize("off", [(0.0, 1.5, 0.0), (-1.2, 0.0, 0.0), (0.0, 0.0, 0.4)], ids=str)
def test_a_pose_that_slips_is_noticed_though_one_thing_fits_by_chance(off: tuple[float, float, float]) -> None:
    model = knowing(FOUR, ("r1", "r2"))
    look_on(model, FOUR, Camera(robot="r2", off=off), 40)
    assert doubted(model, "r2") == LOST


def test_where_one_robot_works_alone_more_may_be_brought_than_taken() -> None:
    model = knowing(TWO[:1])
    look_on(model, [], Camera(yaw=np.pi), 120)  # longer than it stays sure
    brought = [Thing(3.2, -0.8), Thing(4.6, 0.0)]
    assert sorted(look_on(model, brought, Camera(), 20, start_s=80.0)) == ["appeared", "appeared", "gone"]
    assert doubted(model, "r1") == RIGHT
    assert are_at(known(model), brought)


def test_where_one_robot_works_alone_two_of_three_things_may_change() -> None:
    model = knowing(THREE)
    look_on(model, [], Camera(yaw=np.pi), 20)  # it is still sure
    changed = [THREE[0], *(moved(each, 0.0, 1.3) for each in THREE[1:])]
    look_on(model, changed, Camera(), 20, start_s=KNOWN_S + 10)
    assert doubted(model, "r1") == RIGHT
    assert are_at(known(model), changed)


def test_a_robot_with_cameras_on_both_sides_that_stands_still_removes_nothing_that_others_saw() -> None:
    model = knowing(FOUR)
    before = known(model)
    sides = [Camera(y=side, robot="r2", name=f"c{side}") for side in (1.0, -1.0)]
    assert watch(model, [], sides, KNOWN_S, 3 * ALONE_VIEWS_TO_TRUST) == []
    assert known(model) == before


def test_after_a_restart_a_robot_knows_what_it_saw_itself_with_another_camera() -> None:
    model = SiteModel()
    watch(model, FOUR, [Camera(name="back")], 1.0, 20)
    look_on(model, [], Camera(name="front", yaw=np.pi), 2)
    after = SiteModel()
    restored("hall", saved("hall", "a", 0, model), after)
    assert look_on(after, [], Camera(name="front"), 5, start_s=20.0) == ["gone"] * len(FOUR)


def test_all_that_is_taken_away_at_once_is_gone() -> None:
    model = knowing(FOUR)
    assert look_on(model, [], Camera(), 5) == ["gone"] * len(FOUR)
    assert known(model) == []
    assert doubted(model, "r1") == RIGHT


def test_what_another_robot_saw_is_gone_when_one_that_fits_or_looks_for_long_sees_past_it() -> None:
    model = knowing(FOUR)
    other = Camera(robot="r2")
    assert look_on(model, [], other, 4, drives=True) == []
    assert look_on(model, [], other, 8, start_s=13.0, drives=True) == ["gone"] * len(FOUR)
    model = knowing(FOUR)
    assert look_on(model, FOUR, other, 3) == []
    assert look_on(model, [], other, 3, start_s=13.0) == ["gone"] * len(FOUR)


def test_what_is_not_confirmed_yet_is_nothing_when_one_that_just_started_looks_past_it() -> None:
    model = SiteModel()
    watch(model, TWO, [Camera()], 1.0, 2)
    assert len(model.objects.known()) == len(TWO)
    watch(model, [], [Camera(robot="r2")], 2.0, 3)
    assert len(model.objects.known()) == 0


def test_one_that_fitted_long_ago_is_as_unsure_as_one_that_never_did() -> None:
    model = knowing(FOUR, ("r1", "r2"))
    assert look_on(model, [], Camera(robot="r2"), 6, start_s=60.0) == []
    assert look_on(model, [], Camera(robot="r2"), 40, start_s=63.0, drives=True) == ["gone"] * len(FOUR)


def test_some_that_are_moved_together_are_moved_for_one_that_has_just_fitted() -> None:
    model = knowing(TWO)
    elsewhere = [moved(each, 0.0, 1.3) for each in TWO]
    look_on(model, elsewhere, Camera(), 10)
    assert are_at(known(model), elsewhere)
    assert doubted(model, "r1") == RIGHT


@pytest.mark.parametrize("sees_one", [False, True], ids=["both at a time", "one at a time"])
def test_a_robot_that_has_just_fitted_sees_two_things_replaced_where_they_stood(*, sees_one: bool) -> None:
    model = knowing(TWO)
    others = [replace(each, name="crate") for each in TWO]
    for step in range(12):
        at_s = KNOWN_S + step / 2
        blind_to = [step % 2] if sees_one and step > 1 else []
        model.take(view(others, Camera(), at_s, blind_to=blind_to), round(at_s * NS))
        assert doubted(model, "r1") == RIGHT, step


def test_a_stack_that_is_seen_as_one_thing_is_none_that_is_elsewhere() -> None:
    model = knowing(TWO)
    things = [*TWO, Thing(5.0, -0.1, (0.4, 0.4, 1.6))]
    for step in range(20):
        at_s = KNOWN_S + step / 2
        model.take(view(things, Camera(), at_s, blind_to=[0, 1]), round(at_s * NS))
        assert doubted(model, "r1") == RIGHT, step


def test_what_is_well_known_is_nothing_new_for_a_camera_that_seldom_looks() -> None:
    things = [*FOUR, Thing(4.4, -0.3), Thing(5.4, -1.7)]
    model = knowing(things)
    for at_s in (12.0, 36.0, 60.0):
        model.take(view(things, Camera(robot="r2"), at_s, blind_to=[2, 3, 4, 5]), round(at_s * NS))
        assert doubted(model, "r2") == RIGHT, at_s


def test_a_lost_robot_is_noticed_where_two_of_its_cameras_see_the_same() -> None:
    model = knowing(TWO)
    before = known(model)
    cameras = [Camera(robot="r2", name=each, off=(0.0, 1.5, 0.0)) for each in ("left", "right")]
    watch(model, TWO, cameras, KNOWN_S, 20)
    assert doubted(model, "r2") == LOST
    assert {(each.x, each.y) for each in before} <= {(each.x, each.y) for each in known(model)}


@pytest.mark.parametrize("robot", ["r1", "r2"])
def test_a_robot_with_broken_depth_removes_nothing(robot: str) -> None:
    model = knowing(TWO)
    before = known(model)
    assert look_on(model, TWO, Camera(robot=robot), 60, without_depth) == []
    assert known(model) == before
    assert REASONS[doubted(model, robot)] == "its depth does not fit the floor"
    assert look_on(model, TWO, Camera(robot=robot), 5, start_s=42.0) == []
    assert doubted(model, robot) == RIGHT


def test_a_robot_with_broken_depth_is_trusted_late_where_nothing_is_known() -> None:
    model = knowing(TWO)
    look_on(model, TWO, Camera(), 3, without_depth)
    assert doubted(model, "r1") == WRONG_DEPTH
    away = Camera(yaw=np.pi)
    look_on(model, [], away, ALONE_VIEWS_TO_TRUST, without_depth, start_s=13.0)
    assert doubted(model, "r1") == WRONG_DEPTH
    look_on(model, [], away, ALONE_VIEWS_TO_TRUST, start_s=30.0)
    assert doubted(model, "r1") == RIGHT


def test_a_floor_that_is_below_the_maps_zero_is_one() -> None:
    model = SiteModel()
    look_on(model, FOUR, Camera(), 20, partial(higher, by_m=-1.5), start_s=1.0)
    assert len(known(model)) == len(FOUR)
    assert look_on(model, [], Camera(), 6, partial(higher, by_m=-1.5)) == ["gone"] * len(FOUR)


@pytest.mark.parametrize("pits", [1, 3])
def test_a_few_views_that_show_a_pit_do_not_lower_the_floor(pits: int) -> None:
    model = knowing(TWO)
    assert look_on(model, TWO, Camera(), pits, partial(with_low_part, depth_mm=9_900)) == []
    assert look_on(model, TWO, Camera(), 60, without_depth, start_s=13.0) == []
    assert doubted(model, "r1") == WRONG_DEPTH
    assert look_on(model, [], Camera(robot="r2"), ALONE_VIEWS_TO_TRUST, start_s=50.0, drives=True) == ["gone"] * len(
        TWO
    )


def test_where_the_maps_zero_is_below_the_floor_one_that_is_unsure_sees_what_is_gone() -> None:
    model = SiteModel()
    raised = partial(higher, by_m=1.0)
    look_on(model, FOUR, Camera(), 20, raised, start_s=1.0)
    assert len(known(model)) == len(FOUR)
    assert look_on(model, [], Camera(robot="r2"), ALONE_VIEWS_TO_TRUST, raised, drives=True) == ["gone"] * len(FOUR)


def test_a_camera_that_shows_its_own_forks_sees_what_is_gone() -> None:
    def with_forks(seen: CameraView) -> CameraView:
        return with_low_part(seen, 600)

    model = knowing(FOUR)
    look_on(model, FOUR, Camera(robot="r2"), 10, with_forks)
    other = Camera(robot="r2")
    assert look_on(model, [], other, ALONE_VIEWS_TO_TRUST, with_forks, start_s=60.0, drives=True) == ["gone"] * len(
        FOUR
    )


@pytest.mark.parametrize("wavers_m", [0.0, 0.3])
def test_a_robot_just_started_that_stands_still_removes_nothing_that_others_saw(wavers_m: float) -> None:
    model = knowing(FOUR)
    before = known(model)
    cameras = [Camera(robot="r2", off=(side * wavers_m, 0.0, 0.0)) for side in (1, -1)]
    for step in range(5 * ALONE_VIEWS_TO_TRUST):
        assert watch(model, [], cameras[step % 2 :][:1], KNOWN_S + step / 2, 1) == []
    assert known(model) == before


def test_a_site_in_which_no_robot_fits_any_more_has_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offsets_module, "CHANGED_VIEWS", CHANGED_VIEWS // 10)
    model = knowing(FOUR)
    elsewhere = [moved(each, 0.7, -1.0) for each in FOUR]
    look_on(model, elsewhere, Camera(), CHANGED_VIEWS // 10, start_s=16.0, drives=True)
    assert doubted(model, "r1") == LOST
    assert len(known(model)) == len(FOUR)
    look_on(model, elsewhere, Camera(), 50, start_s=70.0)
    assert doubted(model, "r1") == RIGHT
    assert are_at(known(model), elsewhere)
