"""The limit on a stream's rate holds whatever its stamps do; times of arrival are those of a clock of this machine."""

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import accumulate, count, pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.to_bus.shaping.frame_rates import BURST_S, Instants, TokenBucket

MS = 1_000_000
SECOND = 1_000 * MS
BEGIN = 1_700_000_000 * SECOND
SECONDS = 60
MAX_HZ = 5
MOST = MAX_HZ * SECONDS + 1 + MAX_HZ * BURST_S

Arrival = tuple[int, int]
"""When a frame came, and its stamp."""


def camera(hz: float, stamp_of: Callable[[int, int], int] = lambda _, at: at) -> Iterator[Arrival]:
    """Yield what a camera sends in SECONDS. stamp_of: returns the stamp of the n-th frame, made at a time."""
    for n in range(int(SECONDS * hz)):
        at = BEGIN + int(n * SECOND / hz)
        yield at, stamp_of(n, at)


def stepping(every: int, back_ms: int) -> Iterator[Arrival]:
    """Yield frames whose clock is set back at each so manieth one, and goes on from there."""
    return camera(30, lambda n, at: at - n // every * back_ms * MS)


def wavering(back_ms: int) -> Iterator[Arrival]:
    """Yield frames of which each third has a stamp from before."""
    return camera(30, lambda n, at: at - (n % 3 == 2) * back_ms * MS)


def beside_a_replay(hours: float) -> Iterator[Arrival]:
    """Yield a live camera's frames among those of a bag, on one topic."""
    replay = ((at + 7 * MS, stamp - int(hours * 3600 * SECOND)) for at, stamp in camera(30))
    return iter(sorted([*camera(30), *replay]))


CLOCKS: dict[str, Callable[[], Iterator[Arrival]]] = {
    "live beside a replay of an hour ago": lambda: beside_a_replay(1),
    "live beside a replay of tomorrow": lambda: beside_a_replay(-24),
    "set back by 0.5 s each second": lambda: stepping(30, 500),
    "set back by 2 s each second": lambda: stepping(30, 2_000),
    "set back by 2 s at each fifth frame": lambda: stepping(5, 2_000),
    "one of three 2 s old": lambda: wavering(2_000),
    "one of three an hour old": lambda: wavering(3_600_000),
    "each stamp twice, by a clock that is an hour off": lambda: camera(
        30, lambda n, _: BEGIN - 3_600 * SECOND + n // 2 * 33 * MS
    ),
    "a bag of one second that loops": lambda: camera(30, lambda n, _: BEGIN + n % 30 * 33 * MS),
    "a bag that is played ten times as fast": lambda: camera(300, lambda _, at: BEGIN + 10 * (at - BEGIN)),
    "all over a day": lambda: camera(30, lambda n, _: BEGIN + n * 48_611 * SECOND % (86_400 * SECOND)),
    "none": lambda: camera(30, lambda *_: 0),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_stream_sends_as_many_frames_as_the_limit_allows_and_no_more(clock: str) -> None:
    instants = Instants()
    sent = [at for at, stamp in CLOCKS[clock]() if instants.pick("color", stamp, at, MAX_HZ)]
    assert 0.9 * MAX_HZ * SECONDS <= len(sent) <= MOST


@pytest.mark.parametrize("clock", CLOCKS)
def test_colour_and_depth_of_such_clocks_send_the_same_frames(clock: str) -> None:
    instants, sent = Instants(), Counter[str]()
    for at, stamp in CLOCKS[clock]():
        choices = [instants.pick(stream, stamp, at + late, MAX_HZ) for late, stream in enumerate(("color", "depth"))]
        sent.update(["color"] * choices[0] + ["depth"] * choices[1] + ["both"] * all(choices))
    assert max(sent["color"], sent["depth"]) <= MOST
    assert sent["both"] >= 0.9 * MAX_HZ * SECONDS


@pytest.mark.parametrize("hz", [29.97, 30.3, 31])
def test_streams_whose_stamps_drift_past_each_other_keep_the_limit(hz: float) -> None:
    instants, sent = Instants(), Counter[str]()
    arrivals = sorted([(*each, "color") for each in camera(30)] + [(*each, "depth") for each in camera(hz)])
    for at, stamp, stream in arrivals:
        sent[stream] += instants.pick(stream, stamp, at, MAX_HZ)
    assert all(0.9 * MAX_HZ * SECONDS <= count <= MOST for count in sent.values())


def test_streams_with_limits_of_their_own_keep_them_beside_a_replay() -> None:
    instants, sent = Instants(), Counter[str]()
    for at, stamp in beside_a_replay(1):
        for stream, max_hz in (("color", 10), ("depth", MAX_HZ)):
            sent[stream] += instants.pick(stream, stamp, at, max_hz)
    assert 0.9 * 10 * SECONDS <= sent["color"] <= 10 * SECONDS + 1 + 10 * BURST_S
    assert sent["depth"] <= MOST


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 100),
            st.sampled_from(["color", "depth", "points"]),
            st.integers(-5, 5) | st.integers(-(10**5), 10**5),
        ),
        min_size=1,
        max_size=300,
    ),
    st.sampled_from([1, 5, 30]),
)
def test_no_stretch_of_time_has_more_frames_than_the_limit_and_a_burst(
    frames: list[tuple[int, str, int]], max_hz: int
) -> None:
    """Each frame comes some milliseconds after the last, with a stamp that is off by others."""
    instants = Instants()
    sent: dict[str, list[int]] = {"color": [], "depth": [], "points": []}
    for at_ms, (_, stream, off_ms) in zip(accumulate(each[0] for each in frames), frames, strict=True):
        at = BEGIN + at_ms * MS
        if instants.pick(stream, at + off_ms * MS, at, max_hz):
            sent[stream].append(at)
    for times in sent.values():
        for n, begin in enumerate(times):
            for frames_sent, end in enumerate(times[n:], start=1):
                assert frames_sent <= (end - begin) * max_hz / SECOND + 1 + BURST_S * max_hz + 1e-6


@given(late=st.lists(st.integers(0, 400), min_size=1, max_size=40))
def test_a_camera_as_fast_as_the_limit_loses_nothing_to_a_link_that_holds_frames_up(late: list[int]) -> None:
    instants, now, taken = Instants(), 0, 0
    offered = [BEGIN + n * 100 * MS for n in range(300)]
    for n, stamp in enumerate(offered):
        now = max(now, stamp + late[n % len(late)] * MS)
        taken += instants.pick("color", stamp, now, 10)
    assert taken == len(offered)


def test_a_bucket_whose_clock_is_set_back_goes_on_from_there() -> None:
    bucket, sent = TokenBucket(10), []
    for n in count():
        at = n * 50 * MS + (0 if n < 100 else -3_600 * SECOND)
        if bucket.has_room(at):
            bucket.take()
            sent.append(n)
        if n == 200:
            break
    assert 100 <= len(sent) <= 107
    assert max(later - earlier for earlier, later in pairwise(sent)) <= 3
