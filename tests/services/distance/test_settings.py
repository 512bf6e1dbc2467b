import pytest
from pydantic import ValidationError

from services.distance.settings import DistanceSettings


def test_what_is_measured_unless_told_otherwise() -> None:
    settings = DistanceSettings()
    assert settings.frames == ["base_link", "map"]
    assert (settings.criteria.min_pixels, settings.criteria.edge) == (30, 0)
    assert (settings.limits.nearest_m, settings.limits.farthest_m) == (0.1, 20.0)
    assert settings.tolerance_ns is None


def test_a_tolerance_is_told_in_milliseconds() -> None:
    assert DistanceSettings(tolerance_ms=2.5).tolerance_ns == 2_500_000


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("frames", ["a", "b", "c", "d"]),
        ("min_pixels", 0),
        ("edge_pixels", -1),
        ("nearest_m", -0.1),
        ("farthest_m", 0),
        ("tolerance_ms", -1),
        ("worker", "a/b"),
        ("robots", ["a/b"]),
    ],
)
def test_what_is_out_of_range_is_named(field: str, value: object) -> None:
    with pytest.raises(ValidationError) as caught:
        DistanceSettings.model_validate({field: value})
    assert caught.value.errors()[0]["loc"][0] == field


def test_limits_the_wrong_way_round() -> None:
    with pytest.raises(ValidationError, match="farthest_m: 2 must be greater than nearest_m, 2"):
        DistanceSettings(nearest_m=2, farthest_m=2)
