import numpy as np
import pytest

from services.simulator.world import generate
from services.simulator.world.clearance import Clearance
from services.simulator.world.cuboids import Frame
from services.simulator.world.movement import DRIVE_M_S, SLIDE_M_S, Motion, Outline, arcs, slide_way, there_and_back

TRUCK = Outline(np.array([[-1.2, -0.5], [1.5, 0.5]]))


def where(motion: Motion, second: float) -> tuple[float, float, float]:
    place = motion.place(second)
    return place.x, place.y, place.yaw


def test_a_truck_drives_along_its_heading_forwards_and_backwards() -> None:
    here = Frame(1.0, 2.0, 0.0, np.pi / 2)
    motion = arcs(here, [(3.0, 0.0), (-2.0, 0.0)])
    assert motion.lasts_s == pytest.approx(5.0 / DRIVE_M_S)
    assert where(motion, 3.0 / DRIVE_M_S) == pytest.approx((1.0, 5.0, np.pi / 2))
    assert motion.place(99.0).y == pytest.approx(3.0)
    round_about = arcs(Frame(), [(np.pi, 0.5)])
    assert where(round_about, round_about.lasts_s) == pytest.approx((2.0, 2.0, np.pi / 2), abs=0.02)


def test_what_goes_there_and_back_is_where_it_was() -> None:
    here = Frame(1.0, 2.0, 0.0, 0.3)
    out = arcs(here, [(2.0, 0.3)])
    motion = there_and_back(out, 4.0)
    assert motion.lasts_s == pytest.approx(2 * out.lasts_s + 4.0)
    assert motion.place(out.lasts_s + 2.0) == out.place(out.lasts_s)
    assert motion.place(motion.lasts_s) == here
    assert motion.place(out.lasts_s + 4.0 + 0.5).x == pytest.approx(out.place(out.lasts_s - 0.5).x)


def test_goods_keep_their_heading_and_end_where_the_route_does() -> None:
    route = np.array([[0.2, 0.0], [2.0, 0.0], [2.0, 3.0]])
    motion = slide_way(Frame(0.0, 0.0, 0.0, 0.7), route)
    assert motion.place(0.0) == Frame(0.0, 0.0, 0.0, 0.7)
    assert where(motion, motion.lasts_s) == pytest.approx((2.0, 3.0, 0.7))
    steps = np.hypot(*np.diff(motion.places[:, :2], axis=0).T)
    assert steps / np.diff(motion.seconds) == pytest.approx(np.full(len(steps), SLIDE_M_S))
    assert 4.0 < steps.sum() <= 5.0


def test_standing_takes_no_time() -> None:
    place = Frame(1.0, 2.0, 0.0, 3.0)
    assert Motion.standing(place).lasts_s == 0
    assert Motion.standing(place).place(5.0) == place


def test_how_far_points_are_from_an_outline() -> None:
    place = Frame(10.0, 0.0, 0.0, np.pi / 2)
    points = np.array([[10.0, 0.0], [10.0, 2.5], [11.5, 0.0], [10.0, -2.2]])
    assert TRUCK.distance(place, points) == pytest.approx([0.0, 1.0, 1.0, 1.0])
    assert TRUCK.radius == pytest.approx(np.hypot(1.5, 0.5))


def test_there_is_room_where_nothing_stands() -> None:
    scene = generate(3)
    room = Clearance.of(scene)
    widest = np.unravel_index(int(room.grid.argmax()), room.grid.shape)
    x, y = room.points(np.array(widest)).tolist()
    small = Outline(np.array([[-0.2, -0.2], [0.2, 0.2]]))
    assert small.fits(room, Frame(x, y))
    assert not Outline(TRUCK.corners * 5).fits(room, Frame(x, y))
    taken = scene.movables[0].frame
    assert not small.fits(room, Frame(taken.x, taken.y))
