"""Floods that are no messages, short: what they hold is there while they last, and the monitor answers."""

import pytest

from benchmarks.peers.link_flood import FLOODS, HALF_BYTES, LEFT_OUT_BYTES
from benchmarks.security import masks
from benchmarks.security.__main__ import MOST_MB
from benchmarks.security.floods import ASK_S, victim
from bus.presence.token_lists import MOST_OF_ROBOT
from bus.requests.serving import MAX_OPEN_BYTES


@pytest.mark.parametrize("kind", FLOODS)
async def test_a_flood_of_links_is_felt_and_survived(kind: str) -> None:
    async with victim(page=kind == "connections") as monitor:
        found = await monitor.flood(kind, 4.0)
        assert found.answer_s < ASK_S
        assert kind == "listed" or found.rss_growth_mb < MOST_MB
        problems = (await monitor.answer()).problems
    match kind:
        case "tokens":
            assert found.sent >= 1_000
            assert problems == []
        case "listed":
            assert found.sent > MOST_OF_ROBOT
            assert any(" cameras, the most that one robot may have" in each for each in problems)
        case "requests":
            assert found.sent_mb > 2 * MAX_OPEN_BYTES / 2**20
        case "halves":
            assert found.sent_mb == (HALF_BYTES - LEFT_OUT_BYTES) / 2**20
            assert found.rss_growth_mb > HALF_BYTES / 2**20 / 2
        case _:
            assert found.sent > 100


async def test_masks_flood_a_distance_worker_and_another_robot_is_measured_meanwhile() -> None:
    found = await masks.flood_of_masks(2.0)
    assert found["masks_sent"] >= masks.MASKS
    assert 0 < found["masks_answers_alone_s"] < found["masks_answers_s"] < masks.START_S
    assert found["masks_unscheduled_s"] >= 0
    assert found["masks_rss_growth_mb"] < MOST_MB  # unbounded, they took 3.9 GB


def test_a_frame_of_huge_masks_is_small_on_the_wire() -> None:
    seen, depth = masks.huge_frame()
    assert (len(seen.objects), seen.height, seen.width) == (masks.MASKS, masks.SIDE, masks.SIDE)
    assert depth.data.nbytes < 1 << 20
