"""A small fleet of real sessions: the figures of a large one are of the same kind."""

import pytest

from benchmarks.scale.fleet import TOKENS, fleet


@pytest.mark.timeout(120)
async def test_robots_come_one_more_joins_and_all_are_back_after_the_router_was_restarted() -> None:
    async with fleet() as robots:
        came = await robots.grow(3)
        assert came["router_mb"] > 0
        assert 1_000 < await robots.join() < 20_000
        declared = await robots.declarations()
        assert declared["tokens"] == TOKENS + 5  # the caches of info, depth_info, tf, tf_static and status
        restart = await robots.restart()
    assert restart["restart_missing"] == 0
    assert restart["restart_s"] > 0
