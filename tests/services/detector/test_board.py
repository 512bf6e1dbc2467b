import asyncio

import pytest

from schemas.keys import CameraKey
from services.detector.board import Board, Waiting
from tests.schemas.frames import image

FRONT, REAR = CameraKey("r1", "front"), CameraKey("r1", "rear")


def waiting(seq: int) -> Waiting:
    return Waiting(image(seq=seq), arrived_ns=seq)


async def test_the_newest_frame_of_a_camera_replaces_its_older_one() -> None:
    board = Board()
    assert [board.post(FRONT, waiting(0)), board.post(FRONT, waiting(1)), board.post(REAR, waiting(2))] == [0, 1, 0]
    assert await board.take() == (FRONT, waiting(1))
    assert await board.take() == (REAR, waiting(2))


async def test_a_fast_camera_does_not_starve_a_slow_one() -> None:
    board = Board()
    board.post(REAR, waiting(0))
    served = []
    for seq in range(1, 7):
        board.post(FRONT, waiting(seq))
        if seq == 3:
            board.post(REAR, waiting(seq))
        served.append((await board.take())[0])
    assert served == [REAR, FRONT, REAR, FRONT, FRONT, FRONT]


async def test_taking_waits_for_a_frame_and_survives_cancellation() -> None:
    board = Board()
    cancelled = asyncio.create_task(board.take())
    await asyncio.sleep(0)
    cancelled.cancel()
    with pytest.raises(asyncio.CancelledError):
        await cancelled
    taking = asyncio.create_task(board.take())
    await asyncio.sleep(0)
    assert not taking.done()
    board.post(FRONT, waiting(0))
    assert await taking == (FRONT, waiting(0))


async def test_a_discarded_camera_has_nothing_waiting() -> None:
    board = Board()
    board.post(FRONT, waiting(0))
    assert [board.discard(FRONT), board.discard(FRONT)] == [1, 0]
    board.post(REAR, waiting(1))
    assert await board.take() == (REAR, waiting(1))
