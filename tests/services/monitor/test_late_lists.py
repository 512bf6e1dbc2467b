"""Class lists that keep coming late: a problem of the robot's link, told once."""

import msgspec
import pytest

from schemas.keys import CameraKey
from services.monitor.fleet import LATE_FOR_NS, LATE_NS, SLOW_LINK
from tests.schemas.frames import header
from tests.services.monitor.sightings import FRONT, S, online_fleet, seen, status


class Link:
    """One of a robot, whose lists come when they do, after having been on their way for some time."""

    def __init__(self) -> None:
        self.fleet = online_fleet()

    def brings(self, at_s: float, *, late_s: float, spent_s: float = 0.0, camera: str = "front") -> list[str]:
        """Take one list, and that the gateway was heard; return what is wrong with the robot then."""
        at_ns = 1_000 * S + round(at_s * S)
        about = header(camera=camera, seq=self.fleet.class_lists)
        about = msgspec.structs.replace(about, boot_id="boot", received_ns=at_ns - round(late_s * S))
        spans = {"inference": round(spent_s * S)}
        self.fleet.see(msgspec.structs.replace(seen(), header=about, spans=spans), at_s, at_ns)
        return self.hears(at_s)

    def hears(self, at_s: float) -> list[str]:
        """Take that the gateway was heard; return what is wrong with the robot then."""
        self.fleet.gateway_status(status(), 1_000 * S + round(at_s * S))
        return list(self.fleet.problems_of("r1"))


LATE_S = LATE_NS / S + 1
WRONG = [SLOW_LINK]


@pytest.mark.parametrize("period_s", [0.1, 1.0, 5.0])
def test_lists_that_keep_coming_late_are_a_problem_that_stays_one(period_s: float) -> None:
    link = Link()
    enough = round(LATE_FOR_NS / S / period_s)
    assert [link.brings(n * period_s, late_s=LATE_S) for n in range(enough)] == [[]] * enough
    for n in range(enough, 3 * enough):
        assert link.brings(n * period_s, late_s=LATE_S) == WRONG
        assert link.hears((n + 0.9) * period_s) == WRONG


def test_lists_are_late_no_more_when_one_is_in_time_or_none_come() -> None:
    link = Link()
    for at_s in range(12):
        link.brings(at_s, late_s=LATE_S)
    assert link.brings(12, late_s=LATE_NS / S) == []
    assert [link.brings(at_s, late_s=LATE_S) for at_s in range(13, 24)] == [[]] * 10 + [WRONG]
    assert (link.hears(23 + LATE_FOR_NS / S), link.hears(23.1 + LATE_FOR_NS / S)) == (WRONG, [])
    assert link.brings(23.1 + LATE_FOR_NS / S, late_s=LATE_S) == []


def test_what_the_worker_took_is_not_the_links() -> None:
    link = Link()
    assert [link.brings(at_s, late_s=LATE_S, spent_s=1) for at_s in range(20)] == [[]] * 20


def test_lists_that_an_outage_held_up_are_no_problem_however_many_come_at_once() -> None:
    link = Link()
    assert [link.brings(0.001 * n, late_s=12 - 0.1 * n) for n in range(100)] == [[]] * 100


def test_late_lists_are_one_problem_of_all_cameras_that_are_there() -> None:
    link = Link()
    for at_s in range(12):
        link.brings(at_s, late_s=LATE_S)
        link.brings(at_s, late_s=LATE_S, camera="rear")
    assert link.hears(11) == WRONG
    link.fleet.camera_presence(FRONT, alive=False)
    assert link.hears(11) == WRONG
    link.fleet.camera_presence(CameraKey("r1", "rear"), alive=False)
    assert link.hears(11) == []


def test_robots_on_this_machine_or_offline_are_not_elsewhere() -> None:
    fleet = online_fleet()
    assert list(fleet.elsewhere()) == []
    fleet.gateway_status(status("another machine", robot="r2"), 0)
    assert list(fleet.elsewhere()) == []
    fleet.robot_presence("r2", alive=True)
    fleet.robot_presence("r3", alive=True)
    assert list(fleet.elsewhere()) == ["r2"]
