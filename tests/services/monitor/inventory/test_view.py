"""The order of frames."""

from services.monitor.inventory.view import MAX_BOOTS, FrameOrder
from tests.services.monitor.inventory.seeing import S, seen


def taken(order: FrameOrder, seq: int, boot_id: str = "a", at_s: int = 1) -> bool:
    return order.take(seen(seq, {}, boot_id=boot_id).header, at_s * S)


def test_each_frame_is_taken_once_and_none_that_is_older() -> None:
    order = FrameOrder()
    assert [taken(order, seq) for seq in (0, 0, 5, 4, 5, 6)] == [True, False, True, False, False, True]


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
