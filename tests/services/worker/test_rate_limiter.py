import pytest

from services.worker.rate_limiter import SECOND_NS, RateLimiter


def passed(thinning: RateLimiter, times_ns: list[int], hz: float = 2.0, from_ns: int = 0) -> list[int]:
    """Return which of frames pass that come at these times."""
    return [number for number, at_ns in enumerate(times_ns) if thinning.passes(at_ns, hz, from_ns)]


@pytest.mark.parametrize(
    ("hz", "camera_hz", "passed_hz"),
    [(2.0, 1, 1), (2.0, 2, 2), (2.0, 3, 2), (2.0, 5, 2), (2.0, 10, 2), (2.0, 30, 2), (0.5, 30, 0.5)],
)
def test_as_many_pass_as_are_enough(hz: float, camera_hz: int, passed_hz: float) -> None:
    times_ns = [number * SECOND_NS // camera_hz for number in range(100 * camera_hz)]
    assert len(passed(RateLimiter(), times_ns, hz)) == pytest.approx(100 * passed_hz, abs=1)


def test_a_frame_that_comes_a_little_early_passes() -> None:
    assert passed(RateLimiter(), [0, 349_999_999, 350_000_000]) == [0, 2]


def test_frames_pass_from_when_on_they_were_asked_for() -> None:
    thinning = RateLimiter()
    times_ns = [number * SECOND_NS // 10 for number in range(41)]
    assert passed(thinning, times_ns, from_ns=400_000_000)[:2] == [4, 8]
    assert passed(thinning, times_ns[20:], hz=1.0, from_ns=29 * SECOND_NS // 10) == [9, 16], "the turns are other ones"


def test_what_was_asked_for_long_ago_holds() -> None:
    assert passed(RateLimiter(), [9 * SECOND_NS, 9 * SECOND_NS + 1]) == [0]


def test_after_a_gap_no_more_pass_than_else() -> None:
    times_ns = [10 * SECOND_NS + number * SECOND_NS // 10 for number in range(10)]
    assert passed(RateLimiter(), [0, *times_ns]) == [0, 1, 5, 10]


def test_a_clock_that_is_set_back_stops_nothing() -> None:
    assert passed(RateLimiter(), [9 * SECOND_NS, 2 * SECOND_NS, 2 * SECOND_NS + 1], from_ns=8 * SECOND_NS) == [0, 1]
