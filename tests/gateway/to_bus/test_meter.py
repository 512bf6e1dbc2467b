from gateway.to_bus.stream import Meter

S = 1_000_000_000


def test_the_first_reading_says_nothing() -> None:
    assert Meter().hz(100, 5 * S) == 0


def test_rates_are_those_of_the_last_seconds() -> None:
    meter = Meter()
    assert [meter.hz(30 * n, n * S) for n in range(20)][1:] == [30] * 19
    assert [round(meter.hz(570, n * S)) for n in (20, 21, 22, 23, 24)] == [24, 18, 12, 6, 0]


def test_two_readings_at_once_and_a_clock_that_goes_back() -> None:
    meter = Meter()
    meter.hz(0, 10 * S)
    assert meter.hz(5, 10 * S) == 0
    assert meter.hz(5, 3 * S) == 0
    assert meter.hz(7, 4 * S) == 2


def test_a_count_that_shrinks_is_no_rate() -> None:
    meter = Meter()
    meter.hz(5, S)
    assert meter.hz(4, 2 * S) == 0
