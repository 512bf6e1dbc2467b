"""A small fleet of real sessions: the figures of a large one are of the same kind."""

import pytest

from benchmarks.peers.gateways import STREAMS
from benchmarks.scale.declarations import declarations
from benchmarks.scale.fleet import fleet


@pytest.mark.timeout(120)
async def test_robots_come_one_more_joins_and_all_are_back_after_the_router_was_restarted() -> None:
    async with fleet() as robots:
        came = await robots.grow(3)
        assert came["router_mb"] > 0
        assert 1_000 < await robots.join() < 20_000
        restart = await robots.restart()
    assert restart["restart_missing"] == 0
    assert restart["restart_s"] > 0


def test_a_robot_declares_one_publisher_for_each_stream_and_no_more() -> None:
    assert declarations() == {
        "publishers": 1 + len(STREAMS),
        "subscribers": 2,
        "queryables": 2,
        "tokens": 1,
        "caches": 1,
        "watches": 1,
    }
