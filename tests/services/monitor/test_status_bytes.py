import pytest

from schemas.errors import SchemaError
from services.monitor.fleet import Fleet
from services.monitor.status_bytes import MAX_STATUS_BYTES, StatusBytes
from tests.services.monitor.sightings import CLOCK, status


def test_where_there_are_too_many_bytes_those_above_their_share_are_left_out() -> None:
    kept = StatusBytes[str](100, usual=5)
    assert kept.take("large", 90) == []
    assert kept.take("small", 10) == []
    with pytest.raises(SchemaError, match="where all statuses together may have 100"):
        kept.take("large", 91)
    with pytest.raises(SchemaError):
        kept.take("another", 60)
    assert kept.take("another", 30) == ["large"], "it was heard of longest ago"
    assert kept.take("small", 70) == []
    assert kept.take("small", 20) == []


def test_together_they_never_have_more_whatever_their_order() -> None:
    kept, sizes = StatusBytes[int](10_000, usual=50), dict[int, int]()
    for name in range(2_000):
        size = max(1, 10_000 // (len(sizes) + 1))
        for left in kept.take(name, size):
            del sizes[left]
        sizes[name] = size
        assert sum(sizes.values()) <= 10_000


def test_small_ones_of_many_invented_names_keep_nobody_out() -> None:
    kept = StatusBytes[str](10_000, usual=500)
    for number in range(1_000):
        kept.take(f"x{number}", 100)
    left = kept.take("r1", 400)
    assert left == ["x900", "x901", "x902", "x903"], "the rest of them left before"


def test_a_robot_of_the_usual_size_is_kept_beside_any_number_of_large_ones() -> None:
    fleet = Fleet(CLOCK)
    large = 1 << 20
    refused = 0
    for number in range(2 * MAX_STATUS_BYTES // large):
        try:
            fleet.gateway_status(status(robot=f"x{number}"), 0, large)
        except SchemaError:
            refused += 1
    assert len(fleet.gateways) == refused == MAX_STATUS_BYTES // large
    fleet.gateway_status(status(), 1, 2_000)
    assert "r1" in fleet.gateways
