import pytest

from schemas.errors import SchemaError
from services.monitor.fleet import Fleet
from services.monitor.status_bytes import MAX_STATUS_BYTES, StatusBytes
from tests.services.monitor.sightings import CLOCK, status


def test_where_there_are_too_many_bytes_those_above_their_share_are_left_out() -> None:
    kept = StatusBytes[str](100)
    kept.take("large", 90)
    kept.take("small", 10)
    with pytest.raises(SchemaError, match="where all statuses together may have 100"):
        kept.take("large", 91)
    with pytest.raises(SchemaError):
        kept.take("another", 60)
    kept.take("another", 30)
    kept.drop("large")
    kept.take("another", 90)


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
