import pytest
from pydantic import ValidationError

from services.cloud.settings import CloudSettings


def test_what_is_told_reaches_the_limits() -> None:
    settings = CloudSettings(min_points=3, max_points=200, voxel_m=0.5, tolerance_ms=2.5)
    assert (settings.limits.min_points, settings.limits.max_points, settings.limits.voxel_m) == (3, 200, 0.5)
    assert settings.tolerance_ns == 2_500_000
    assert CloudSettings().tolerance_ns is None


@pytest.mark.parametrize("points", [{"front": "a b"}, {"a b": "lidar"}, {"front": "tf"}])
def test_points_are_from_sensors_that_have_names(points: dict[str, str]) -> None:
    with pytest.raises(ValidationError, match="name"):
        CloudSettings(points=points)
