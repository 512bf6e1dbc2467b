from bus.sharing.pace import HEADROOM, LONGEST_S, Pace, Totals


def flooded() -> Pace:
    """Return what knows that 20 frames a second get done and as many are lost."""
    made = Pace()
    made.look(Totals(), 4, 0)
    assert made.look(Totals(done=20, lost=20, busy_s=1), 4, 1)
    return made


def test_nothing_lost_no_limit() -> None:
    made = Pace()
    assert not made.look(Totals(), 4, 0)
    assert not made.look(Totals(done=20, lost=2, busy_s=1), 4, 1)
    assert made.limit_hz is None


def test_the_limit_is_what_gets_done_in_the_time_it_takes() -> None:
    assert flooded().limit_hz == 20 * HEADROOM
    made = Pace()
    made.look(Totals(), 4, 0)
    made.look(Totals(done=10, lost=10, busy_s=0.5), 4, 2)
    assert made.limit_hz == 20 * HEADROOM


def test_a_window_lasts_until_each_camera_had_two_turns() -> None:
    made = flooded()
    assert made.limit_hz is not None
    two_turns_s = 2 * 40 / made.limit_hz
    assert not made.look(Totals(done=80, lost=60, busy_s=4), 40, 0.99 + two_turns_s)
    assert made.look(Totals(done=80, lost=60, busy_s=4), 40, 1.01 + two_turns_s)


def test_a_window_of_few_frames_lasts_longer_but_not_for_ever() -> None:
    made = Pace()
    made.look(Totals(), 1, 0)
    few = Totals(done=9, lost=9, busy_s=1)
    assert not made.look(few, 1, LONGEST_S - 0.1)
    assert made.look(few, 1, LONGEST_S)


def test_down_while_frames_are_lost_by_half_of_what_is_lost() -> None:
    made = flooded()
    made.look(Totals(done=38, lost=22, busy_s=2), 4, 2)
    assert made.limit_hz == 20 * HEADROOM * (1 - 0.1 / 2)


def test_frames_that_another_consumer_asked_for_do_not_push_it_below_what_gets_done() -> None:
    made = flooded()
    for second in range(2, 3_000):
        made.look(Totals(done=10 * second, lost=90 * second, busy_s=second), 4, second)
    assert made.limit_hz is not None
    assert round(made.limit_hz, 6) == 10 * HEADROOM


def test_up_while_there_is_time_left() -> None:
    made = flooded()
    made.look(Totals(done=36, lost=20, busy_s=1.75), 4, 2)
    assert made.limit_hz == 20 * HEADROOM * (1 + 0.25 / 2)


def test_frames_lost_at_leisure_are_not_the_limits_fault() -> None:
    made = flooded()
    made.look(Totals(done=30, lost=25, busy_s=1.4), 4, 2)
    assert made.limit_hz is not None
    assert made.limit_hz > 20 * HEADROOM


def test_it_stays_where_little_is_lost_and_little_time_is_left() -> None:
    made = flooded()
    assert not made.look(Totals(done=38, lost=21, busy_s=1.96), 4, 2)
    assert not made.look(Totals(done=56, lost=22, busy_s=2.86), 4, 3)


def test_it_ends_when_cameras_send_much_less_than_they_might() -> None:
    made = flooded()
    assert made.look(Totals(done=30, lost=20, busy_s=1.5), 4, 3)
    assert made.limit_hz is None


def test_a_worker_without_frames_learns_nothing() -> None:
    made = flooded()
    assert not made.look(Totals(done=20, lost=20, busy_s=1), 0, 20)
    assert made.limit_hz == 20 * HEADROOM


def test_counts_that_are_forgotten_are_no_gain() -> None:
    pace = Pace()
    pace.look(Totals(0, 100, 0), 4, 0)
    assert not pace.look(Totals(50, 50, 0.9), 4, 1)
    assert pace.limit_hz is None
