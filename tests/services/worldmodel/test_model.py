"""What a site's model knows after robots have looked at scenes of boxes."""

from collections.abc import Mapping
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from schemas.world import ChangeKind
from services.worldmodel import model as model_module
from services.worldmodel import object_lifecycle
from services.worldmodel.model import SiteModel
from services.worldmodel.object_lifecycle import Rules
from services.worldmodel.offsets import LOST, RIGHT
from services.worldmodel.placement import TOO_FAR
from tests.services.worldmodel.scene import NS, Camera, Thing, around, known, moved, view, watch

BOX = Thing(4.0, 0.0)
ROW = [Thing(3.5, 0.5 * index - 1.0, (0.4, 0.45, 0.4)) for index in range(5)]


SPREAD = [Thing(*at) for at in ((3.0, -0.8), (3.6, 0.9), (4.4, -0.1), (5.2, 1.6), (5.6, -1.7), (6.3, 0.5))]


def test_what_two_robots_see_is_one_thing() -> None:
    model = SiteModel()
    first, second = Camera(robot="r1"), Camera(4.0, 4.0, -np.pi / 2, robot="r2")
    assert watch(model, [BOX], [first, second], 1.0, 6) == ["appeared"]
    (found,) = known(model)
    assert (found.x, found.y, found.z) == pytest.approx((4.0, 0.0, 0.0), abs=0.06)
    assert found.size == pytest.approx((0.4, 0.4, 0.4), abs=0.1)


def test_a_thing_seen_from_all_sides_is_where_and_as_large_as_it_is() -> None:
    model = SiteModel()
    pallet = Thing(10.0, -20.0, (1.2, 0.8, 0.14), yaw=0.5, name="pallet")
    watch(model, [pallet], around(10.0, -20.0, 3.0, 8), 1.0, 4)
    (found,) = known(model)
    assert (found.x, found.y) == pytest.approx((10.0, -20.0), abs=0.05)
    assert found.size == pytest.approx((1.2, 0.8, 0.14), abs=0.12)
    assert found.yaw == pytest.approx(0.5, abs=0.15)


def test_once_is_not_enough() -> None:
    model = SiteModel()
    assert watch(model, [BOX], [Camera()], 1.0, 2) == []
    assert watch(model, [BOX], [Camera()], 2.0, 1) == ["appeared"]


def test_who_asks_is_told_which_object_each_detection_of_each_view_belongs_to() -> None:
    told: list[tuple[str, Mapping[int, int]]] = []
    model = SiteModel(identify=lambda view, numbers: told.append((view.header.robot, numbers)))
    first, second = Camera(robot="r1"), Camera(0.0, 0.5, 0.0, robot="r2")
    things = [Thing(4.0, 1.0), BOX, Thing(4.0, -1.0)]
    model.take(view(things, first, 1.0), NS)
    numbers = told[-1][1]
    assert (told[-1][0], sorted(numbers)) == ("r1", [0, 1, 2])
    assert len(set(numbers.values())) == 3
    both = [(view(things, first, 1.5, blind_to=[1]), 15 * NS // 10), (view(things, second, 1.5), 15 * NS // 10)]
    model.take_all(both)
    assert told[-2:] == [("r1", {0: numbers[0], 2: numbers[2]}), ("r2", numbers)]


def test_things_in_a_row_and_in_a_stack_stay_apart() -> None:
    model = SiteModel()
    stack = [Thing(3.5, 2.0, (0.4, 0.4, 0.3), z=0.3 * level) for level in range(3)]
    watch(model, [*ROW, *stack], [Camera(), Camera(0.0, 1.0, 0.1, robot="r2")], 1.0, 10)
    found = known(model)
    assert len(found) == len(ROW) + len(stack)
    assert [each.z for each in found if each.y > 1.5] == pytest.approx([0.0, 0.3, 0.6], abs=0.04)


def test_what_is_hidden_is_not_gone() -> None:
    model = SiteModel()
    watch(model, [BOX], [Camera()], 1.0, 6)
    wall = Thing(2.5, 0.0, (0.2, 2.0, 2.0), name="shelf")
    assert "gone" not in watch(model, [wall], [Camera()], 4.0, 20)
    assert {each.name for each in known(model)} == {"box", "shelf"}


def test_what_is_out_of_view_is_not_gone() -> None:
    model = SiteModel()
    watch(model, [BOX], [Camera()], 1.0, 6)
    assert watch(model, [], [Camera(yaw=np.pi)], 4.0, 50) == []
    assert len(known(model)) == 1


def test_what_the_detector_misses_is_not_gone() -> None:
    model = SiteModel()
    watch(model, [BOX], [Camera()], 1.0, 10)
    for step in range(10):
        at_s = 6.0 + step / 2
        assert model.take(view([BOX], Camera(), at_s, blind_to=[0]), round(at_s * NS)) == []
    assert len(known(model)) == 1


def test_what_somebody_looks_past_is_gone_but_not_after_one_look() -> None:
    model = SiteModel()
    watch(model, [BOX], [Camera()], 1.0, 10)
    assert watch(model, [], [Camera()], 6.0, 1) == []
    assert watch(model, [], [Camera()], 6.5, 5) == ["gone"]
    assert known(model) == []


def test_a_pallet_is_low_and_yet_is_noticed_to_be_gone() -> None:
    pallet = Thing(3.5, 0.0, (1.2, 0.8, 0.144), name="pallet")
    model = SiteModel()
    watch(model, [pallet], [Camera()], 1.0, 10)
    assert len(known(model)) == 1
    assert watch(model, [], [Camera()], 6.5, 4) == ["gone"]


def test_what_is_back_has_its_old_id_and_what_comes_elsewhere_a_new_one() -> None:
    model = SiteModel()
    watch(model, [BOX], [Camera()], 1.0, 8)
    watch(model, [], [Camera()], 6.0, 6)
    assert watch(model, [BOX], [Camera()], 10.0, 4) == ["back"]
    assert model.objects.number[model.objects.told_to_others()].tolist() == [0]
    watch(model, [], [Camera()], 14.0, 8)
    watch(model, [moved(BOX, 0.0, 1.2)], [Camera()], 20.0, 4)
    (number,) = model.objects.number[model.objects.told_to_others()].tolist()
    assert number != 0


def test_what_moves_while_it_is_seen_keeps_its_id() -> None:
    model = SiteModel()
    forklift = Thing(4.5, -1.5, (1.6, 1.1, 2.0), name="forklift")
    watch(model, [forklift], [Camera()], 1.0, 6)
    kinds: list[str] = []
    for step in range(8):
        kinds += watch(model, [moved(forklift, 0.0, 0.4 * step)], [Camera()], 4.0 + step / 2, 1)
    kinds += watch(model, [moved(forklift, 0.0, 2.8)], [Camera()], 8.0, 4)
    assert "moved" in kinds
    assert not {"gone", "appeared"} & set(kinds)
    assert model.objects.number[model.objects.told_to_others()].tolist() == [0]


def test_a_robot_that_is_off_is_set_right_by_what_others_saw() -> None:
    model = SiteModel()
    things = [*ROW, Thing(5.5, 2.0), Thing(5.5, -2.0)]
    watch(model, things, [Camera(robot="r1"), Camera(1.0, 0.5, robot="r2")], 1.0, 20)
    off = Camera(robot="r3", off=(0.06, -0.08, 0.015))
    watch(model, things, [off], 12.0, 10)
    assert len(known(model)) == len(things)
    offset = model.offsets.state[model.robots.number("r3")]
    assert offset == pytest.approx([-0.06, 0.08, -0.015], abs=0.045)


def test_a_lost_robot_is_doubted_and_spoils_nothing() -> None:
    model = SiteModel()
    watch(model, SPREAD, [Camera()], 1.0, 12)
    before = [(each.x, each.y) for each in known(model)]
    lost = Camera(robot="r2", off=(0.0, 0.9, 0.4))
    watch(model, SPREAD, [lost], 8.0, 12)
    assert model.offsets.doubted[model.robots.number("r2")] == LOST
    assert model.left_out["r2", model_module.DOUBTED] > 0
    right = [each for each in known(model) if any(np.hypot(each.x - x, each.y - y) < 0.1 for x, y in before)]
    assert len(right) == len(SPREAD)
    watch(model, SPREAD, [replace(lost, off=(0.0, 0.0, 0.0))], 16.0, 8)
    assert model.offsets.doubted[model.robots.number("r2")] == RIGHT


def test_a_pose_that_jumps_is_doubted_until_it_fits() -> None:
    model = SiteModel()
    watch(model, ROW, [Camera()], 1.0, 12)
    watch(model, ROW, [Camera(off=(30.0, 0.0, 0.0))], 7.5, 1)
    assert model.offsets.doubted[0] != RIGHT
    watch(model, ROW, [Camera()], 8.0, 4)
    assert model.offsets.doubted[0] == RIGHT
    assert len(known(model)) == len(ROW)


def test_ghosts_of_one_frame_are_never_told_and_are_forgotten() -> None:
    model = SiteModel(Rules(most_new=20))
    rng = np.random.default_rng(3)
    for step in range(40):
        camera, at_s = Camera(), 1.0 + step / 2
        ghosts = [
            msgspec.structs.replace(each, at=(float(rng.uniform(2, 8)), float(rng.uniform(-2, 2)), each.at[2]))
            for each in view(ROW, camera, at_s).objects * 8
        ]
        model.take(view([BOX], camera, at_s, extra=ghosts), round(at_s * NS))
    assert len(model.objects.known()) < 1_000
    assert model.left_out["r1", object_lifecycle.FLOOD] > 0
    model.take(view([], Camera(yaw=np.pi), 120.0), 120 * NS)
    assert (~model.objects.confirmed[model.objects.known()]).sum() == 0


def test_nonsense_is_left_out_and_attributed() -> None:
    model = SiteModel()
    seen = view([BOX], Camera(robot="r7"), 1.0)
    (box,) = seen.objects
    wrong = [
        msgspec.structs.replace(box, at=(500.0, 0.0, 0.2)),
        msgspec.structs.replace(box, depth_m=900.0),
        msgspec.structs.replace(box, low_m=2.0, high_m=1.0),
        msgspec.structs.replace(box, low_m=5e8, high_m=5e8 + 0.3),
        msgspec.structs.replace(box, low_m=-50.0),
        msgspec.structs.replace(box, high_m=50.0),
        msgspec.structs.replace(box, reach_mm=[2_000_000] * 12),
    ]
    model.take(msgspec.structs.replace(seen, objects=wrong), NS)
    assert model.left_out["r7", TOO_FAR] == len(wrong)
    assert len(model.objects.known()) == 0


def test_a_robot_without_a_map_is_counted() -> None:
    model = SiteModel()
    blind = msgspec.structs.replace(
        view([], Camera(robot="r9"), 1.0), position=None, unlocated="no map", grid=None, unmeasured={"box": 3}
    )
    assert model.take(blind, NS) == []
    assert model.left_out["r9", model_module.UNLOCATED] == 3


def test_a_full_site_takes_no_more() -> None:
    model = SiteModel(Rules(most_objects=3))
    watch(model, ROW, [Camera()], 1.0, 6)
    assert len(known(model)) == 3
    assert model.left_out["r1", object_lifecycle.TOO_MANY] > 0


def test_views_taken_together_say_the_same_as_one_by_one() -> None:
    one, together = SiteModel(), SiteModel()
    cameras = [Camera(robot="r1"), Camera(0.5, 0.5, robot="r2"), Camera(0.0, -0.5, robot="r3")]
    events: list[ChangeKind] = []
    for step in range(8):
        views = [(view(ROW, camera, 1.0 + step / 2), NS + step * NS // 2) for camera in cameras]
        events += [event.kind for event in together.take_all(views)]
        for each, at_ns in views:
            one.take(each, at_ns)
    assert events == [ChangeKind.APPEARED] * len(ROW)
    for found, same in zip(known(together), known(one), strict=True):
        assert (found.x, found.y) == pytest.approx((same.x, same.y), abs=0.05)


def test_after_the_clock_was_set_back_what_is_seen_and_not_seen_counts_at_once() -> None:
    model = SiteModel()
    watch(model, [BOX], [Camera()], 3_600.0, 10)
    model.set_back(5 * NS)
    (at_ns,) = model.offsets.at_ns[: len(model.robots.names)].tolist()
    assert at_ns == 5 * NS
    assert watch(model, [], [Camera()], 6.0, 6) == ["gone"]
    assert known(model) == []
