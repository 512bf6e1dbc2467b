import itertools
from collections import Counter
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.to_bus.shaping.frame_rates import SAME_NS, SECOND_NS, UNMATCHED_LIMIT, Instants, StreamRate

MS = 1_000_000
BEGIN = 1_700_000_000_000 * MS
STREAMS = ("color", "depth", "points")


def stamps(hz: float, seconds: float = 10, *, begin: int = BEGIN, jitter: Iterator[int] | None = None) -> list[int]:
    """Return the stamps of a camera."""
    period = 1_000_000_000 / hz
    return [begin + int(n * period) + (next(jitter) if jitter else 0) for n in range(int(seconds * hz))]


def picked(instants: Instants, stream: str, offered: list[int], max_hz: float) -> list[int]:
    return [stamp for stamp in offered if instants.pick(stream, stamp, stamp, max_hz)]


@st.composite
def arrivals(draw: st.DrawFn) -> list[tuple[str, int, int]]:
    """Return (stream, instant, stamp) in an order of arrival that keeps each stream's own; every stream misses some."""
    gaps = draw(st.lists(st.integers(11, 120), min_size=1, max_size=60))
    instants = [BEGIN + sum(gaps[: n + 1]) * MS for n in range(len(gaps))]
    late = {stream: draw(st.integers(0, 400)) * MS for stream in STREAMS}
    sent = []
    for stream in STREAMS:
        for number, stamp in enumerate(instants):
            if draw(st.integers(0, 3)):
                sent.append((stamp + late[stream], stream, number, stamp + draw(st.integers(0, 5)) * MS))
    return [(stream, number, stamp) for _, stream, number, stamp in sorted(sent)]


@settings(max_examples=60)
@given(arrivals(), st.floats(0.5, 60))
def test_whatever_a_stream_missed_and_however_late_it_is_an_instant_is_picked_for_all_or_none(
    sent: list[tuple[str, int, int]], max_hz: float
) -> None:
    instants = Instants()
    decided: dict[int, bool] = {}
    for stream, number, stamp in sent:
        choice = instants.pick(stream, stamp, stamp, max_hz)
        assert decided.setdefault(number, choice) == choice


@settings(max_examples=60)
@given(arrivals(), st.floats(0.5, 30), st.floats(0.5, 30))
def test_what_a_slow_stream_sends_a_fast_one_sends_too(
    sent: list[tuple[str, int, int]], one: float, other: float
) -> None:
    instants = Instants()
    for stream, rate in (("color", max(one, other)), ("depth", min(one, other))):
        instants.pick(stream, 1, 1, rate)
    taken: dict[str, set[int]] = {"color": set(), "depth": set()}
    offered: dict[str, set[int]] = {"color": set(), "depth": set()}
    for stream, number, stamp in sent:
        if stream in taken:
            offered[stream].add(number)
            if instants.pick(stream, stamp, stamp, max(one, other) if stream == "color" else min(one, other)):
                taken[stream].add(number)
    assert taken["depth"] & offered["color"] <= taken["color"]


@given(st.lists(st.integers(1, 300), min_size=1, max_size=200), st.sampled_from([1, 5, 10, 30]))
def test_no_time_has_more_than_one_frame_too_many(gaps: list[int], max_hz: int) -> None:
    offered = [BEGIN + sum(gaps[: n + 1]) * MS for n in range(len(gaps))]
    sent = picked(Instants(), "color", offered, max_hz)
    for n, begin in enumerate(sent):
        for frames, end in enumerate(sent[n:], start=1):
            assert frames <= (end - begin) * max_hz / 1_000_000_000 + 2


@pytest.mark.parametrize("native", [5, 9.9, 10, 10.1, 15, 29.97, 30, 90])
@settings(max_examples=25)
@given(jitter=st.lists(st.integers(-3 * MS, 3 * MS), min_size=1, max_size=50))
def test_the_rate_is_what_was_asked_for_or_what_the_camera_has(native: float, jitter: list[int]) -> None:
    repeated = (jitter[n % len(jitter)] for n in range(10_000))
    sent = picked(Instants(), "color", stamps(native, jitter=repeated), 10)
    assert 0.97 * min(native, 10) * 10 - 1 <= len(sent) <= 10 * 10 + 2


def test_half_as_many_of_thirty_are_evenly_spaced() -> None:
    sent = picked(Instants(), "color", stamps(30), 15)
    assert {b - a for a, b in itertools.pairwise(sent)} <= {66_666_666, 66_666_667}


@pytest.mark.parametrize("offset", [16, 7])
def test_streams_whose_stamps_never_meet_keep_their_rates(offset: int) -> None:
    instants = Instants()
    sent: dict[str, list[int]] = {"color": [], "depth": []}
    for stamp in stamps(30):
        for stream, at in (("color", stamp), ("depth", stamp + offset * MS)):
            if instants.pick(stream, at, at, 10):
                sent[stream].append(at)
    assert {stream: len(found) >= 97 for stream, found in sent.items()} == {"color": True, "depth": True}


def test_a_lidar_of_its_own_clock_leaves_colour_and_depth_together() -> None:
    instants = Instants()
    frames = sorted(
        [(stamp, stream) for stream in ("color", "depth") for stamp in stamps(30)]
        + [(stamp, "points") for stamp in stamps(12, begin=BEGIN + 8 * MS)]
    )
    sent: dict[str, set[int]] = {stream: set() for stream in STREAMS}
    for stamp, stream in frames:
        if instants.pick(stream, stamp, stamp, 5):
            sent[stream].add(stamp)
    assert sent["color"] == sent["depth"]
    assert all(45 <= len(found) <= 51 for found in sent.values())


@pytest.mark.parametrize("hours", [-1, 1])
def test_a_sensor_with_a_clock_that_is_hours_off_stops_nobody(hours: int) -> None:
    instants = Instants()
    off = hours * 3_600_000 * MS
    sent: dict[str, int] = {"color": 0, "depth": 0, "points": 0}
    for n, stamp in enumerate(stamps(30)):
        for stream, at in (("points", stamp + off), ("color", stamp), ("depth", stamp)):
            sent[stream] += (stream != "points" or n % 3 == 0) and instants.pick(stream, at, at, 5)
    assert sent["color"] == sent["depth"]
    assert all(48 <= count <= 60 for count in sent.values())


def test_a_slower_stream_sends_only_what_the_faster_one_sends() -> None:
    instants = Instants()
    frames = sorted([(stamp, "color") for stamp in stamps(30)] + [(stamp, "depth") for stamp in stamps(30)[::2]])
    sent: dict[str, set[int]] = {"color": set(), "depth": set()}
    for stamp, stream in frames:
        if instants.pick(stream, stamp, stamp, 10):
            sent[stream].add(stamp)
    assert sent["depth"] <= sent["color"]
    assert 98 <= len(sent["depth"]) <= len(sent["color"]) <= 101


@pytest.mark.parametrize("first", ["color", "depth"])
@pytest.mark.parametrize("late_ms", [0, 50, 250])
@pytest.mark.parametrize(
    ("every", "skipped", "max_hz", "depth_hz"),
    [(3, 1, 10, 10), (3, 2, 5, 5), (2, 1, 7.5, 7.5), (5, 1, 5, 5), (4, 3, 10, 7.5), (30, 7, 10, 1), (30, 7, 2, 1)],
)
def test_the_faster_stream_sends_instants_at_which_the_slower_one_has_a_frame(
    *, first: str, late_ms: int, every: int, skipped: int, max_hz: float, depth_hz: float
) -> None:
    instants = Instants()
    color = stamps(30, 20, jitter=itertools.cycle([0, 2 * MS, -2 * MS, MS, -MS]))
    depth = color[skipped::every]
    late = {"color": 0 if first == "color" else late_ms * MS, "depth": late_ms * MS if first == "color" else 0}
    frames = [(stamp, "color") for stamp in color] + [(stamp, "depth") for stamp in depth]
    frames.sort(key=lambda frame: (frame[0] + late[frame[1]], frame[1] != first))
    sent: dict[str, set[int]] = {"color": set(), "depth": set()}
    for stamp, stream in frames:
        if instants.pick(stream, stamp, stamp, max_hz):
            sent[stream].add(stamp)
    assert sent["depth"] <= sent["color"]
    assert len(sent["depth"]) >= 0.85 * depth_hz * 20
    assert 0.85 * min(max_hz, depth_hz) * 20 <= len(sent["color"]) <= max_hz * 20 + 2
    assert first == "depth" or len(sent["color"]) >= 0.85 * max_hz * 20


@pytest.mark.parametrize("offset_ms", [-4, 0, 4])
@pytest.mark.parametrize(("max_hz", "lost"), [(10, 0), (10, 4), (5, 0)])
def test_a_slower_stream_keeps_its_rate_though_it_loses_frames_and_is_a_little_off(
    *, offset_ms: int, max_hz: float, lost: int
) -> None:
    """lost: each so manieth of its frames, none if it is 0."""
    instants, color = Instants(), stamps(30, 20)
    depth = [stamp + offset_ms * MS for n, stamp in enumerate(color[1::3]) if not lost or n % lost]
    frames = sorted([(stamp, "color") for stamp in color] + [(stamp, "depth") for stamp in depth])
    sent: dict[str, list[int]] = {"color": [], "depth": []}
    for stamp, stream in frames:
        if instants.pick(stream, stamp, stamp, max_hz):
            sent[stream].append(stamp)
    assert len(sent["depth"]) >= 0.95 * min(len(depth), max_hz * 20)
    assert 0.95 * max_hz * 20 <= len(sent["color"]) <= max_hz * 20 + 1


@pytest.mark.parametrize("every_ms", [120, 150, 180, 199, 250])
def test_a_slower_stream_with_uneven_gaps_keeps_its_rate(every_ms: int) -> None:
    """Depth that has the stamps of the pictures nearest to where its own would be."""
    instants, color = Instants(), stamps(30, 20)
    places = [int(n * every_ms * 30 / 1000 + 0.5) for n in range(20_000 // every_ms)]
    depth = [color[place] for place in places]
    frames = sorted([(stamp, "color") for stamp in color] + [(stamp, "depth") for stamp in depth])
    sent = Counter(stream for stamp, stream in frames if instants.pick(stream, stamp, stamp, 10))
    assert sent["depth"] >= 0.9 * len(depth)
    assert sent["color"] >= 0.95 * 10 * 20


def test_a_stream_that_has_ended_is_waited_for_no_longer() -> None:
    instants = Instants()
    for n, stamp in enumerate(stamps(30)):
        instants.pick("color", stamp, stamp, 10)
        if n % 3 == 1:
            instants.pick("depth", stamp, stamp, 10)
    assert len(picked(instants, "color", stamps(30, begin=BEGIN + 10 * SECOND_NS), 10)) >= 99


@pytest.mark.parametrize("late", [0, 5])
def test_a_bag_that_loops_starts_over_for_all_streams(late: int) -> None:
    instants, loop = Instants(), stamps(30, 3)
    color = loop * 3
    depth = [*[None] * late, *loop * 3]
    sent: dict[str, list[int]] = {"color": [], "depth": []}
    for at, after in zip(color, depth, strict=False):
        for stream, stamp in (("color", at), ("depth", after)):
            if stamp is not None and instants.pick(stream, stamp, stamp, 10):
                sent[stream].append(stamp)
    assert sent["color"] == sent["color"][:30] * 3
    assert sent["depth"] == sent["color"][: len(sent["depth"])]
    assert len(sent["depth"]) >= 88


def test_a_stream_that_slept_through_the_jump_finds_the_others_again() -> None:
    instants = Instants()
    before, after = stamps(30, 5), stamps(30, 20)
    for stream in ("color", "depth"):
        picked(instants, stream, before, 10)
    picked(instants, "color", after[:300], 10)
    for stamp in after[300:]:
        choice = instants.pick("color", stamp, stamp, 10)
        assert instants.pick("depth", stamp, stamp, 10) == choice


@pytest.mark.parametrize("stamp", [0, BEGIN])
def test_stamps_that_say_nothing_are_replaced_by_the_time_of_arrival(stamp: int) -> None:
    instants = Instants()
    sent = [now for now in stamps(30) if instants.pick("color", stamp, now, 10)]
    assert 100 <= len(sent) <= 101


def test_a_limit_can_change_and_be_lifted() -> None:
    instants = Instants()
    rate_limiter = StreamRate(lambda: instants, "color", 10)
    first, second, third = stamps(30, 1), stamps(30, 1, begin=BEGIN + 1000 * MS), stamps(30, 1, begin=BEGIN + 2000 * MS)
    assert sum(rate_limiter.passes(stamp, stamp) for stamp in first) == 10
    rate_limiter.max_hz = 5
    assert sum(rate_limiter.passes(stamp, stamp) for stamp in second) == 5
    rate_limiter.max_hz = None
    assert all(rate_limiter.passes(stamp, stamp) for stamp in third)


def test_what_is_remembered_is_bounded() -> None:
    instants = Instants()
    for n in range(2000):
        instants.pick("color", BEGIN + n * 100 * MS, 0, 10 + n / 1000)
    for n in range(2000):
        instants.pick("depth", BEGIN + n, 0, 10)
    run = instants._newest
    assert max(len(run._instants), len(run._due)) <= 256
    assert max(map(len, run._instants.values())) <= 16


def test_streams_share_a_moment_and_one_that_is_alone_has_none() -> None:
    instants = Instants()
    first = instants.moment("color", SECOND_NS, 0)
    assert first is not None
    assert instants.moment("depth", SECOND_NS + SAME_NS, 0) is first
    second = instants.moment("color", 2 * SECOND_NS, 0)
    assert second is not None
    assert (second.of, second.number > first.number, second.begun) == (first.of, True, False)
    lidar = []
    for n in range(3, UNMATCHED_LIMIT + 5):
        instants.moment("color", n * SECOND_NS, 0)
        lidar.append(instants.moment("points", n * SECOND_NS + SECOND_NS // 2, 0))
    assert None not in lidar[:UNMATCHED_LIMIT]
    assert lidar[-1] is None


@pytest.mark.parametrize("first", ["color", "depth"])
def test_a_stream_shares_the_moments_of_one_that_has_far_fewer(first: str) -> None:
    instants = Instants()
    for n in range(1, 200):
        fewer = n % 30 == 0
        streams = sorted(["color"] * fewer + ["depth"], reverse=first == "depth")
        moments = [instants.moment(stream, n * 33 * MS, 0) for stream in streams]
        assert None not in moments
        assert len(set(map(id, moments))) == 1
