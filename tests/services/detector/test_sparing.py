import pytest

from services.detector.sparing import SECOND_NS, Sparing


@pytest.mark.parametrize(
    ("most_hz", "camera_hz", "passed_hz"),
    [(None, 30, 30), (2.0, 1, 1), (2.0, 2, 2), (2.0, 3, 2), (2.0, 5, 2), (2.0, 10, 2), (2.0, 30, 2)],
)
def test_as_many_pass_as_are_enough(most_hz: float | None, camera_hz: int, passed_hz: float) -> None:
    sparing = Sparing(most_hz)
    passed = sum(sparing.passes(number * SECOND_NS // camera_hz) for number in range(100 * camera_hz))
    assert passed == pytest.approx(100 * passed_hz, abs=1)


def test_a_frame_that_comes_a_little_early_passes() -> None:
    sparing = Sparing(2.0)
    assert sparing.passes(0)
    assert not sparing.passes(349_999_999)
    assert sparing.passes(350_000_000)


def test_after_a_gap_no_more_pass_than_else() -> None:
    sparing = Sparing(2.0)
    assert sparing.passes(0)
    passed = [sparing.passes(10 * SECOND_NS + number * SECOND_NS // 10) for number in range(10)]
    assert passed == [number in (0, 4, 9) for number in range(10)]


def test_a_clock_that_is_set_back_stops_nothing() -> None:
    sparing = Sparing(2.0)
    assert sparing.passes(9 * SECOND_NS)
    assert sparing.passes(2 * SECOND_NS)
    assert not sparing.passes(2 * SECOND_NS + 1)
