from services.monitor.inventory.order import MAX_BOOTS, FrameOrder
from tests.services.monitor.inventory.seeing import seen


def taken(order: FrameOrder, seq: int, boot_id: str = "a") -> bool:
    return order.take(seen(seq, {}, boot_id=boot_id).header)


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
