import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.to_bus.shaping.uplink import BACKLOG_S, HELD_BYTES, Moment, Uplink

RATE = 1_000_000.0
FULL = int(RATE * BACKLOG_S)


class Link:
    """Sends RATE bytes a second. unsent: what it has not sent yet of what it was given."""

    def __init__(self) -> None:
        self.unsent = 0.0
        self._at_s = 0.0

    def give(self, size: int, now_s: float) -> None:
        self.unsent = max(0.0, self.unsent - RATE * (now_s - self._at_s)) + size
        self._at_s = now_s


class Streams:
    """Streams that offer an item of one size each, period after period, through one uplink; time is counted in ms."""

    def __init__(self, sizes: dict[str, int], periods_ms: dict[str, int]) -> None:
        self.uplink: Uplink[str, int] = Uplink(RATE)
        self.link = Link()
        self.sizes = sizes
        self.periods_ms = periods_ms
        self.sent: dict[str, list[int]] = {stream: [] for stream in sizes}
        self.replaced = 0

    def run(self, seconds: int) -> None:
        for now_ms in range(seconds * 1000):
            for stream, period in self.periods_ms.items():
                if now_ms % period == 0:
                    self.replaced += self.uplink.offer(stream, now_ms, self.sizes[stream])
            for stream, offered_ms in self.uplink.release(now_ms / 1000):
                self.sent[stream].append(offered_ms)
                self.link.give(self.sizes[stream], now_ms / 1000)
            assert self.link.unsent <= max(FULL, *self.sizes.values()) + 1

    def bytes_of(self, stream: str) -> int:
        return len(self.sent[stream]) * self.sizes[stream]


def streams_of(largest: int) -> st.SearchStrategy[list[tuple[int, int]]]:
    """Return sizes in bytes and periods in milliseconds."""
    return st.lists(st.tuples(st.integers(1, largest), st.integers(10, 100)), min_size=1, max_size=5)


SECONDS = 4


def ran(streams: list[tuple[int, int]]) -> Streams:
    named = {f"s{n}": stream for n, stream in enumerate(streams)}
    run = Streams({name: size for name, (size, _) in named.items()}, {name: ms for name, (_, ms) in named.items()})
    run.run(SECONDS)
    return run


@settings(max_examples=30, deadline=None)
@given(streams_of(FULL // 2))
def test_the_budget_is_used_and_shared(streams: list[tuple[int, int]]) -> None:
    run = ran(streams)
    asked = {f"s{n}": size * 1000 / period * SECONDS for n, (size, period) in enumerate(streams)}
    budget = RATE * SECONDS
    given_bytes = sum(map(run.bytes_of, asked))
    assert min(sum(asked.values()), budget) * 0.9 - FULL <= given_bytes <= budget + FULL
    for name, wish in asked.items():
        for other in asked.keys() - {name}:
            if run.sizes[name] <= run.sizes[other]:  # at most one frame waits, so small ones cannot make up in bytes,
                # and of streams that keep in step one may meet a full link again and again
                assert len(run.sent[name]) >= min(wish / run.sizes[name], len(run.sent[other])) * 0.6 - 2
            else:
                assert run.bytes_of(name) >= min(wish, run.bytes_of(other)) * 0.8 - FULL


@settings(max_examples=30, deadline=None)
@given(streams_of(3 * FULL))
def test_nobody_starves_however_large_the_frames_of_others_are(streams: list[tuple[int, int]]) -> None:
    run = ran(streams)
    round_s = len(streams) * max(size for size, _ in streams) / RATE + BACKLOG_S
    for n, (_, period) in enumerate(streams):
        sent = run.sent[f"s{n}"]
        assert len(sent) >= SECONDS / (round_s + period / 1000) - 2
        assert sent == sorted(set(sent))


def test_small_frames_pass_while_a_large_stream_asks_for_more_than_there_is() -> None:
    run = Streams({"large": FULL, "small": FULL // 100}, {"large": 33, "small": 33})
    run.run(10)
    assert len(run.sent["small"]) >= 90
    assert run.bytes_of("large") >= 0.85 * RATE * 10
    assert run.replaced > 0


def test_a_frame_larger_than_the_backlog_goes_when_nothing_is_queued() -> None:
    uplink: Uplink[str, str] = Uplink(RATE)
    uplink.offer("large", "first", 5 * FULL)
    assert uplink.release(0) == [("large", "first")]
    uplink.offer("large", "second", 5 * FULL)
    uplink.offer("small", "third", 1)
    assert uplink.release(0.3999) == []
    assert uplink.release(0.4001) == [("small", "third")]
    assert uplink.release(0.4999) == []
    assert uplink.release(0.5001) == [("large", "second")]


def test_results_go_at_once_and_are_counted() -> None:
    uplink: Uplink[str, int] = Uplink(RATE)
    uplink.charge(FULL, 0)
    uplink.offer("color", 1, FULL // 2)
    assert uplink.release(0) == []
    assert uplink.next_release_s() == pytest.approx(BACKLOG_S / 2, abs=1e-5)
    assert uplink.release(BACKLOG_S / 2) == [("color", 1)]


def test_results_that_no_link_can_hold_take_nothing_of_the_budget_afterwards() -> None:
    uplink: Uplink[str, int] = Uplink(RATE)
    for second in range(600):
        uplink.charge(2 * int(RATE), second)
    uplink.offer("color", 1, FULL)
    assert uplink.release(600) == [("color", 1)]
    uplink.charge(5 * HELD_BYTES, 600)
    uplink.offer("color", 2, FULL)
    assert uplink.release(600) == []
    free_s = 600 + (FULL + HELD_BYTES) / RATE
    assert uplink.release(free_s - 0.001) == []
    assert uplink.release(free_s) == [("color", 2)]


def test_the_newest_waits_and_keeps_its_place() -> None:
    uplink: Uplink[str, int] = Uplink(RATE)
    uplink.charge(FULL, 0)
    assert uplink.offer("color", 1, FULL) == 0
    assert uplink.offer("depth", 2, FULL) == 0
    assert uplink.offer("color", 3, FULL) == 1
    assert uplink.release(BACKLOG_S) == [("color", 3)]
    assert uplink.release(2 * BACKLOG_S) == [("depth", 2)]
    assert uplink.next_release_s() is None


def test_who_was_silent_has_nothing_saved_up() -> None:
    uplink: Uplink[str, int] = Uplink(RATE)
    now = 0.0
    for n in range(100):
        uplink.offer("busy", n, FULL)
        assert uplink.release(now) == [("busy", n)]
        now += BACKLOG_S
    turns = []
    for n in range(10):
        uplink.offer("busy", n, FULL)
        uplink.offer("late", n, FULL)
        turns += [stream for stream, _ in uplink.release(now)]
        now += BACKLOG_S
    assert 4 <= turns.count("busy") <= 6


def test_a_stream_that_is_gone_holds_up_nobody() -> None:
    uplink: Uplink[str, int] = Uplink(RATE)
    uplink.charge(FULL, 0)
    uplink.offer("gone", 1, FULL)
    uplink.offer("color", 2, FULL)
    assert (uplink.discard("gone"), uplink.discard("gone")) == (1, 0)
    assert uplink.release(BACKLOG_S) == [("color", 2)]


def test_a_clock_that_stands_still_or_goes_back_gives_nothing() -> None:
    uplink: Uplink[str, int] = Uplink(RATE)
    uplink.charge(FULL, 10)
    uplink.offer("color", 1, FULL)
    assert uplink.release(10) == []
    assert uplink.release(9) == []
    assert uplink.release(10 + BACKLOG_S) == [("color", 1)]


def moment_items(
    sizes: dict[str, int], late_ms: dict[str, int], seconds: int, every: dict[str, int] | None = None
) -> dict[str, list[int]]:
    """Return by stream the moments that were sent, of 30 a second, each stream's item so much later than its moment.

    every: of so many moments a stream has an item of one only.
    """
    uplink: Uplink[str, int] = Uplink(RATE)
    link = Link()
    moments = [Moment("front", number) for number in range(30 * seconds)]
    sent: dict[str, list[int]] = {stream: [] for stream in sizes}
    for now_ms in range(seconds * 1000):
        for stream, size in sizes.items():
            number, phase = divmod(now_ms - late_ms[stream], 33)
            if phase == 0 and 0 <= number < len(moments) and number % (every or {}).get(stream, 1) == 0:
                uplink.offer(stream, number, size, moments[number])
        for stream, number in uplink.release(now_ms / 1000):
            sent[stream].append(number)
            link.give(sizes[stream], now_ms / 1000)
        assert link.unsent <= max(FULL, *sizes.values()) + 1
        list(uplink.lost())
    return sent


@pytest.mark.parametrize(
    "sizes",
    [
        {"color": FULL // 3, "depth": FULL, "points": 2 * FULL},
        {"color": 3 * FULL, "depth": FULL // 2, "points": FULL // 4},
        {"color": FULL // 2, "depth": FULL // 2, "points": FULL // 2},
    ],
)
def test_what_is_of_one_moment_is_sent_together(sizes: dict[str, int]) -> None:
    sent = moment_items(sizes, {"color": 0, "depth": 5, "points": 15}, 20)
    first, *others = (set(numbers) for numbers in sent.values())
    for other in others:
        assert len(first & other) >= 0.95 * max(len(first), len(other)) - 1
    assert sum(len(sent[stream]) * size for stream, size in sizes.items()) >= 0.8 * RATE * 20
    assert all(numbers == sorted(numbers) for numbers in sent.values())


@pytest.mark.parametrize(
    ("sizes", "every"),
    [
        ({"color": FULL // 5, "depth": 3 * FULL}, {"color": 6}),
        ({"color": FULL // 5, "depth": FULL // 2, "points": FULL}, {"color": 6}),
        ({"color": FULL // 3, "depth": FULL, "points": FULL}, {"points": 3}),
        ({"color": FULL // 5, "depth": FULL}, {"color": 30}),
    ],
)
@pytest.mark.parametrize("late_ms", [{"color": 0, "depth": 5, "points": 15}, {"color": 20, "depth": 15, "points": 0}])
def test_a_stream_with_fewer_items_is_sent_with_those_of_its_moments(
    sizes: dict[str, int], every: dict[str, int], late_ms: dict[str, int]
) -> None:
    sent = moment_items(sizes, late_ms, 20, every)
    together = set.intersection(*map(set, sent.values()))
    (rare,) = every
    asked = 600 / every[rare]
    carried = RATE * 20 / sum(sizes.values())
    assert len(together) >= 0.9 * min(asked, carried) - 1
    assert len(sent[rare]) <= len(together) + 2
    assert all(numbers == sorted(numbers) for numbers in sent.values())


def test_nothing_is_left_out_while_there_is_room_for_all_however_late_a_stream_is() -> None:
    sent = moment_items({"color": FULL // 100, "points": FULL // 10}, {"color": 0, "points": 100}, 4)
    assert sent["color"] == list(range(len(sent["color"])))
    assert sent["points"] == list(range(len(sent["points"])))
    assert len(sent["points"]) >= 4 * 30 - 5


def test_a_moment_that_has_begun_is_not_replaced_and_what_came_too_late_for_it_is_lost() -> None:
    uplink: Uplink[str, str] = Uplink(RATE)
    first, second, third = (Moment("front", number) for number in range(3))
    uplink.offer("depth", "depth 0", FULL, first)
    assert uplink.release(0) == [("depth", "depth 0")]
    assert uplink.offer("color", "color 1", FULL, second) == 0
    assert uplink.offer("color", "color 0", FULL, first) == 0
    assert uplink.offer("color", "color 2", FULL, third) == 1
    assert uplink.offer("points", "points 1", FULL, second) == 0
    assert uplink.release(BACKLOG_S) == [("color", "color 0")]
    assert uplink.release(2 * BACKLOG_S) == [("color", "color 2")]
    assert list(uplink.lost()) == ["points 1"]
    assert list(uplink.lost()) == []
    assert uplink.offer("points", "points 1 again", FULL, second) == 1
    assert uplink.next_release_s() is None


def test_a_stream_that_is_gone_leaves_both_of_its_items() -> None:
    uplink: Uplink[str, int] = Uplink(RATE)
    first, second = Moment("front", 0), Moment("front", 1)
    uplink.offer("color", 1, FULL, first)
    assert uplink.release(0) == [("color", 1)]
    uplink.offer("depth", 2, FULL, first)
    uplink.offer("depth", 3, FULL, second)
    assert uplink.discard("depth") == 2
    assert uplink.next_release_s() is None


def test_moments_of_what_is_forgotten_may_begin_again_at_any_number() -> None:
    uplink: Uplink[str, int] = Uplink(RATE)
    uplink.offer("color", 1, FULL, Moment("front", 7))
    assert uplink.release(0) == [("color", 1)]
    assert uplink.offer("color", 2, FULL, Moment("front", 0)) == 1
    uplink.forget_moments("front")
    assert uplink.offer("color", 3, FULL, Moment("front", 0)) == 0
    assert uplink.release(BACKLOG_S) == [("color", 3)]
