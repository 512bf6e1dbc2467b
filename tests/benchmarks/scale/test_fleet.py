"""A small fleet of real sessions: the figures of a large one are of the same kind."""

import pytest

from benchmarks.peers.gateways import STREAMS
from benchmarks.scale.declarations import declarations
from benchmarks.scale.fleet import Kind, fleet


@pytest.mark.timeout(120)
@pytest.mark.parametrize("kind", ["alone", "beside"])
async def test_robots_come_one_more_joins_and_all_are_back_after_the_router_was_restarted(kind: Kind) -> None:
    async with fleet(kind) as robots:
        came = await robots.grow(3)
        assert came["router_mb"] > 0
        assert 1_000 < await robots.join() < 20_000
        restart = await robots.restart()
    assert restart["restart_missing"] == 0
    assert restart["restart_s"] > 0


@pytest.mark.parametrize(("kind", "publishers"), [("alone", 1), ("beside", 1 + len(STREAMS))])
def test_only_a_robot_with_services_beside_it_declares_every_stream(kind: Kind, publishers: int) -> None:
    assert declarations(kind) == {
        "publishers": publishers,
        "subscribers": 2,
        "queryables": 2,
        "tokens": 1,
        "caches": 1,
        "watches": 1,
    }
