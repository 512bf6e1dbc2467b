import asyncio

import pytest

from schemas.keys import CameraKey
from services.detector.frame_queue import FrameQueue, QueuedFrame
from tests.schemas.frames import image

FRONT, REAR, SIDE = (CameraKey("r1", name) for name in ("front", "rear", "side"))


def waiting(seq: int, late_ns: int = 0) -> QueuedFrame:
    return QueuedFrame(image(seq=seq), arrived_ns=seq, late_ns=late_ns)


def test_the_newest_frame_of_a_camera_replaces_its_older_one() -> None:
    frame_queue = FrameQueue()
    assert [
        frame_queue.post(FRONT, waiting(0)),
        frame_queue.post(FRONT, waiting(1)),
        frame_queue.post(REAR, waiting(2)),
    ] == [0, 1, 0]
    assert frame_queue.take(1) == [(FRONT, waiting(1))]
    assert frame_queue.take(1) == [(REAR, waiting(2))]
    assert frame_queue.take(1) == []


def test_a_fast_camera_does_not_starve_a_slow_one() -> None:
    frame_queue = FrameQueue()
    frame_queue.post(REAR, waiting(0))
    served = []
    for seq in range(1, 7):
        frame_queue.post(FRONT, waiting(seq))
        if seq == 3:
            frame_queue.post(REAR, waiting(seq))
        served.append(frame_queue.take(1)[0][0])
    assert served == [REAR, FRONT, REAR, FRONT, FRONT, FRONT]


def test_of_60_hz_and_5_hz_at_20_a_second_the_slow_one_loses_nothing() -> None:
    frame_queue = FrameQueue()
    served = []
    for tick in range(600):
        frame_queue.post(FRONT, waiting(tick))
        if tick % 12 == 0:
            assert frame_queue.post(REAR, waiting(tick)) == 0
        if tick % 3 == 0:
            served += [key for key, _ in frame_queue.take(1)]
    assert (served.count(REAR), len(served)) == (50, 200)


def test_a_batch_is_of_different_cameras_those_served_longest_ago_first() -> None:
    frame_queue = FrameQueue()
    for key in (FRONT, REAR, SIDE):
        frame_queue.post(key, waiting(0))
    assert [key for key, _ in frame_queue.take(2)] == [FRONT, REAR]
    frame_queue.post(FRONT, waiting(1))
    frame_queue.post(REAR, waiting(1))
    assert [key for key, _ in frame_queue.take(2)] == [SIDE, FRONT]
    assert frame_queue.by_turn([SIDE, FRONT, REAR]) == [REAR, SIDE, FRONT]


def test_what_is_too_old_is_taken_down_and_its_camera_keeps_its_turn() -> None:
    frame_queue = FrameQueue()
    for key in (FRONT, REAR):
        frame_queue.post(key, waiting(0))
    frame_queue.take(1)
    frame_queue.post(FRONT, waiting(5))
    assert frame_queue.expire(10, 9) == [REAR]
    frame_queue.post(REAR, waiting(11))
    assert [key for key, _ in frame_queue.take(2)] == [REAR, FRONT]


@pytest.mark.parametrize(("late_ns", "expired"), [(0, []), (4, []), (5, [FRONT])])
def test_how_late_a_frame_came_counts_to_its_age(late_ns: int, expired: list[CameraKey]) -> None:
    frame_queue = FrameQueue()
    frame_queue.post(FRONT, waiting(0, late_ns))
    assert frame_queue.expire(6, 10) == expired


def test_a_clock_that_is_set_back_makes_no_frame_younger() -> None:
    assert waiting(5, late_ns=2).age_ns(1) == 2


async def test_waiting_for_a_frame_survives_cancellation() -> None:
    frame_queue = FrameQueue()
    cancelled = asyncio.create_task(frame_queue.filled(1, 0))
    await asyncio.sleep(0)
    cancelled.cancel()
    with pytest.raises(asyncio.CancelledError):
        await cancelled
    filled = asyncio.create_task(frame_queue.filled(1, 0))
    await asyncio.sleep(0)
    assert not filled.done()
    frame_queue.post(FRONT, waiting(0))
    await filled


async def test_a_fuller_board_is_waited_for_until_it_is_full() -> None:
    frame_queue = FrameQueue()
    frame_queue.post(FRONT, waiting(0))
    filled = asyncio.create_task(frame_queue.filled(2, 60))
    await asyncio.sleep(0)
    frame_queue.post(FRONT, waiting(1))
    await asyncio.sleep(0.01)
    assert not filled.done()
    frame_queue.post(REAR, waiting(1))
    await filled


async def test_a_fuller_board_is_not_waited_for_longer_than_it_is_worth() -> None:
    frame_queue = FrameQueue()
    frame_queue.post(FRONT, waiting(0))
    async with asyncio.timeout(60):
        await frame_queue.filled(2, 0.01)


def test_a_discarded_camera_has_nothing_waiting() -> None:
    frame_queue = FrameQueue()
    frame_queue.post(FRONT, waiting(0))
    assert [frame_queue.discard(FRONT), frame_queue.discard(FRONT)] == [1, 0]
    frame_queue.post(REAR, waiting(1))
    assert frame_queue.take(9) == [(REAR, waiting(1))]
