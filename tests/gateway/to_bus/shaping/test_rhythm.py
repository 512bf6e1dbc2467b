import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.to_bus.shaping.frame_rates import FITTED_FRAMES, PREDICTED_FRAMES, Rhythm

MS = 1_000_000
BEGIN = 1_700_000_000_000 * MS


def noted(*stamps_ms: float) -> Rhythm:
    made = Rhythm()
    for stamp in stamps_ms:
        made.note(BEGIN + round(stamp * MS))
    return made


def expected_ms(rhythm: Rhythm, since_ms: float) -> float | None:
    found = rhythm.next_ns(BEGIN + round(since_ms * MS))
    return None if found is None else (found - BEGIN) / MS


@pytest.mark.parametrize("stamps", [(), (0,), (0, 0), (100, 0)])
def test_of_less_than_two_frames_in_order_nothing_is_expected(stamps: tuple[float, ...]) -> None:
    assert (noted(*stamps).interval_ns, expected_ms(noted(*stamps), 50)) == (0, None)


def test_a_frame_is_expected_after_each_interval_and_not_told_of_too_far_ahead() -> None:
    rhythm = noted(0, 100, 200)
    assert [expected_ms(rhythm, since) for since in (150, 200, 201, 300, 950)] == [200, 200, 300, 300, 1000]
    assert expected_ms(rhythm, 200 + 100 * PREDICTED_FRAMES) == 200 + 100 * PREDICTED_FRAMES
    assert expected_ms(rhythm, 201 + 100 * PREDICTED_FRAMES) is None


def test_lost_frames_do_not_change_it() -> None:
    assert expected_ms(noted(0, 100, 300, 400, 700, 800), 801) == 900


@pytest.mark.parametrize("now_ms", [30, 70, 200, 470])
def test_a_stream_that_is_slower_or_faster_now(now_ms: int) -> None:
    after = [200 + now_ms * (n + 1) for n in range(FITTED_FRAMES)]
    assert expected_ms(noted(0, 100, 200, *after), after[-1] + 1) == after[-1] + now_ms


def test_a_clock_that_went_back() -> None:
    assert expected_ms(noted(5000, 5100, 0, 50), 51) == 100


@settings(max_examples=50)
@given(st.floats(75, 1000), st.floats(0, 1))
def test_of_a_faster_streams_stamps_the_one_nearest_to_where_a_frame_is_expected_is_its(
    interval_ms: float, phase: float
) -> None:
    """Or, at times, the one beside it."""
    faster_ms = 1000 / 30
    frames = [int(interval_ms * (n + phase) / faster_ms + 0.5) for n in range(300)]
    rhythm, off = Rhythm(), []
    for last, frame in itertools.pairwise(frames):
        rhythm.note(BEGIN + round(last * faster_ms * MS))
        expected = expected_ms(rhythm, (last + 0.5) * faster_ms)
        off.append(1.0 if expected is None else abs(expected / faster_ms - frame))
    settled = off[2 * FITTED_FRAMES :]
    assert sum(each < 0.5 for each in settled) >= 0.65 * len(settled)
    assert sum(each < 1 for each in settled) >= 0.8 * len(settled)
