import msgspec

from schemas.header import LONGEST_GAP, Header
from schemas.keys import CameraKey
from schemas.status import MISSING
from services.detector.frame_counts import ABOVE_OPINION_RATE, DOUBLE, FAILED, MALFORMED, REPLACED, STALE, FrameCounts
from tests.schemas.frames import header


def about(seq: int, boot_id: str = "boot") -> Header:
    return msgspec.structs.replace(header(seq=seq), boot_id=boot_id)


def tally(*arrivals: tuple[Header, int]) -> FrameCounts:
    made = FrameCounts(CameraKey("r1", "front"))
    for arrival in arrivals:
        made.arrived(*arrival)
    return made


def test_a_stream_without_holes_drops_nothing() -> None:
    assert tally((about(3), 0), (about(4), 0)).load(serving=True).dropped == {}


def test_a_gap_is_what_the_queue_replaced_and_the_rest_was_lost_on_the_link() -> None:
    assert tally((about(3), 0), (about(10), 4)).load(serving=True).dropped == {REPLACED: 4, MISSING: 2}


def test_a_jump_of_more_numbers_than_can_be_lost_is_no_gap() -> None:
    most = 2**63 - 1
    assert tally((about(0), 0), (about(LONGEST_GAP + 1), 0)).load(serving=True).dropped == {MISSING: LONGEST_GAP}
    assert tally((about(0), 0), (about(LONGEST_GAP + 2), 0)).load(serving=True).dropped == {}
    assert tally((about(0), 0), (about(most), 4)).load(serving=True).dropped == {REPLACED: 4}


def test_an_older_frame_is_no_gap() -> None:
    assert tally((about(3), 0), (about(1), 0)).load(serving=True).dropped == {}


def test_the_same_frame_again_is_counted_as_that() -> None:
    made = tally((about(3), 0))
    assert not made.arrived(about(3), 0)
    assert made.arrived(about(3, "next"), 0)
    assert made.arrived(about(4, "next"), 0)
    assert made.load(serving=True).dropped == {DOUBLE: 1}


def test_a_restarted_gateway_is_no_gap() -> None:
    assert tally((about(3), 0), (about(90, "next"), 0)).load(serving=True).dropped == {}


def test_a_pause_of_ours_is_no_gap() -> None:
    made = tally((about(3), 0))
    made.begin()
    made.arrived(about(90), 0)
    assert made.load(serving=True).dropped == {}


def test_the_account_as_a_message() -> None:
    made = tally()
    made.done = 2
    made.dropped[MALFORMED] += 1
    load = made.load(serving=True)
    assert (load.robot, load.camera, load.inferred, load.dropped) == ("r1", "front", 2, {MALFORMED: 1})


def test_a_malformed_frame_is_counted_once_and_is_no_gap() -> None:
    made = tally((about(3), 0))
    made.malformed(replaced=2)
    made.arrived(about(9), 0)
    assert made.load(serving=True).dropped == {MALFORMED: 1, REPLACED: 2}


def test_what_was_replaced_unread_may_have_another_reason() -> None:
    made = FrameCounts(CameraKey("r1", "front"), unread=ABOVE_OPINION_RATE)
    made.arrived(about(3), 0)
    made.arrived(about(6), 2)
    made.malformed(replaced=1)
    assert made.load(serving=True).dropped == {ABOVE_OPINION_RATE: 3, MALFORMED: 1}
    assert made.too_many == 0


def test_too_many_are_those_that_were_replaced_or_too_old() -> None:
    made = tally()
    made.dropped.update({REPLACED: 3, STALE: 2, FAILED: 9})
    assert made.too_many == 5


def test_the_account_says_whether_the_camera_is_served_and_what_was_asked_for() -> None:
    load = tally().load(serving=True, budget_hz=2.5)
    assert (load.serving, load.budget_hz) == (True, 2.5)
