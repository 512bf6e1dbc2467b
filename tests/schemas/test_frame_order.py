"""The order of frames, also against numbers that are made up."""

import pytest

from schemas.header import LONGEST_GAP, MAX_BOOTS, MAX_COUNT, FrameOrder, Header

S = 1_000_000_000


def header(seq: int, boot_id: str = "a") -> Header:
    return Header(robot="r1", camera="front", boot_id=boot_id, seq=seq, stamp_ns=0, frame_id="", received_ns=0)


def taken(order: FrameOrder, seq: int, boot_id: str = "a", at_s: float = 1) -> bool:
    return order.take(header(seq, boot_id), round(at_s * S))


def test_each_frame_is_taken_once_and_none_that_is_older() -> None:
    order = FrameOrder()
    assert [taken(order, seq) for seq in (0, 0, 5, 4, 5, 6)] == [True, False, True, False, False, True]
    assert order.late == 3


def test_a_restarted_gateway_counts_from_zero_and_what_its_old_process_sent_is_late() -> None:
    order = FrameOrder()
    assert taken(order, 100, "a")
    assert taken(order, 0, "b")
    assert not taken(order, 101, "a")
    assert not taken(order, 0, "b")
    assert taken(order, 1, "b")


def test_as_many_processes_are_remembered_as_is_said() -> None:
    order = FrameOrder()
    assert all(taken(order, 0, f"boot {number}") for number in range(MAX_BOOTS))
    assert not taken(order, 1, "boot 0")
    assert taken(order, 0, "another")
    assert taken(order, 1, "boot 0")


def test_of_two_gateways_under_one_name_the_one_that_runs_on_is_heard_again() -> None:
    order = FrameOrder()
    assert taken(order, 100, "a", 1)
    assert taken(order, 0, "b", 2)
    assert not taken(order, 103, "a", 5)
    assert taken(order, 6, "b", 5)
    assert not taken(order, 100, "a", 9), "of what was taken before nothing is news"
    assert taken(order, 107, "a", 9)
    assert taken(order, 108, "a", 9)
    assert not taken(order, 7, "b", 10)


def test_a_stream_may_be_joined_at_any_number() -> None:
    assert taken(FrameOrder(), MAX_COUNT - 5, at_s=1)


@pytest.mark.parametrize("forged", [MAX_COUNT, 10 + LONGEST_GAP + 1])
def test_one_message_far_ahead_costs_no_frame(forged: int) -> None:
    order = FrameOrder()
    assert taken(order, 10)
    assert not taken(order, forged)
    assert [taken(order, seq) for seq in (11, 12, 13)] == [True, True, True]
    assert (order.implausible, order.late) == (1, 0)


def test_a_count_that_really_is_far_ahead_costs_one_frame() -> None:
    order = FrameOrder()
    assert taken(order, 10)
    assert [taken(order, 5 * LONGEST_GAP + more) for more in range(3)] == [False, True, True]
    assert order.implausible == 1


def test_a_sender_whose_numbers_are_stamps_loses_one_frame() -> None:
    order = FrameOrder()
    stamps = [1_000 * S + step * 33_333_333 for step in range(20)]
    assert [taken(order, seq) for seq in stamps] == [True, False] + [True] * 18


@pytest.mark.parametrize("forged", [(20_000,), (MAX_COUNT - 1, MAX_COUNT)])
def test_forged_numbers_that_are_believed_blind_a_stream_for_seconds_alone(forged: tuple[int, ...]) -> None:
    order = FrameOrder()
    assert taken(order, 10, at_s=0)
    for number in forged:
        taken(order, number, at_s=0.1)
    heard = [taken(order, 11 + step, at_s=0.2 + step / 10) for step in range(100)]
    first = heard.index(True)
    assert 30 <= first <= 32, "a little more than QUIET_NS at ten frames a second"
    assert all(heard[first:])
    assert order.late == first


def test_the_first_message_may_be_the_forged_one() -> None:
    order = FrameOrder()
    assert taken(order, MAX_COUNT, at_s=0)
    assert not taken(order, 7, at_s=1)
    assert not taken(order, 8, at_s=3.5)
    assert taken(order, 9, at_s=4.1)
    assert taken(order, 10, at_s=4.2)


def test_kept_frames_that_come_again_in_a_burst_are_no_news_however_late() -> None:
    order = FrameOrder()
    assert taken(order, 100, at_s=0)
    for again in (60, 75, 90):  # workers return one after the other, each with some of them
        burst = [taken(order, seq, at_s=again + seq / 1000) for seq in range(50, 101)]
        assert not any(burst)
    assert taken(order, 101, at_s=100)


def test_late_frames_are_late_while_newer_ones_come() -> None:
    order = FrameOrder()
    for step in range(100):
        assert taken(order, 1_000 + step, at_s=step / 10)
        assert not taken(order, 900 + step, at_s=step / 10)


def test_a_clock_that_is_set_back_delays_nothing_for_longer_than_the_silence_itself() -> None:
    order = FrameOrder()
    assert taken(order, 100, at_s=1_000)
    order.set_back(10 * S)
    assert not taken(order, 5, at_s=10)
    assert taken(order, 6, at_s=13.1)


def test_asking_alone_remembers_nothing() -> None:
    order = FrameOrder()
    assert order.admits(header(5), S)
    assert order.admits(header(5), S)
    order.note(header(5), S)
    assert not order.admits(header(5), S)


def test_a_slow_stream_recovers_too() -> None:
    order = FrameOrder()
    assert taken(order, MAX_COUNT, at_s=0)
    assert [taken(order, seq, at_s=5.0 * seq) for seq in (1, 2, 3)] == [False, True, True]
