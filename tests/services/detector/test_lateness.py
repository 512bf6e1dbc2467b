from services.detector.camera import BUCKET_NS, Lateness

MS = 1_000_000
HOUR = 3_600_000 * MS


def test_the_quickest_frame_is_not_late_whatever_the_clocks_say() -> None:
    for ahead in (-HOUR, 0, HOUR):
        made = Lateness()
        assert [made.late_ns(at, at + ahead + took) for at, took in ((0, 5), (10, 3), (20, 7))] == [0, 0, 4]


def test_frames_that_waited_while_we_stood_still_are_late() -> None:
    made = Lateness()
    for at in range(10):
        made.late_ns(at * 100 * MS, at * 100 * MS + MS)
    woken = 7_000 * MS
    assert [made.late_ns(sent * MS, woken) for sent in (1_000, 1_100)] == [5_999 * MS, 5_899 * MS]


def test_a_clock_that_was_set_is_believed_after_a_while() -> None:
    made = Lateness()
    made.late_ns(0, 0)
    set_back = HOUR
    times = [BUCKET_NS - 1, BUCKET_NS, 2 * BUCKET_NS - 1, 2 * BUCKET_NS]
    assert [made.late_ns(at - set_back, at) for at in times] == [HOUR, HOUR, HOUR, 0]


def test_a_clock_of_ours_that_was_set_back_makes_nothing_late() -> None:
    made = Lateness()
    made.late_ns(0, HOUR)
    assert made.late_ns(MS, MS) == 0
