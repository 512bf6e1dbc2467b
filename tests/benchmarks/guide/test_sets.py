import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.guide.sets import Arrival, ages_ms, complete, mean_sizes

S = 1_000_000_000
TOPICS = ("image", "text")


def image(stamp_s: int, at_s: float) -> Arrival:
    return Arrival("image", round(at_s * S), stamp_s * S, 100)


def text(at_s: float, size: int = 10) -> Arrival:
    return Arrival("text", round(at_s * S), 0, size)


def test_a_set_needs_every_output() -> None:
    assert complete([image(1, 1.1), text(1.2)], TOPICS) == 1
    assert complete([image(1, 1.1), image(2, 2.1), text(1.2)], TOPICS) == 1
    assert complete([image(1, 1.1)], TOPICS) == 0
    assert complete([text(1.1)], TOPICS) == 0
    assert complete([], TOPICS) == 0


def test_outputs_with_stamps_count_for_the_same_image_only() -> None:
    other = Arrival("points", 3 * S, 2 * S, 1)
    topics = (*TOPICS, "points")
    assert complete([image(1, 1.1), text(1.2), other], topics) == 0
    assert complete([image(1, 1.1), image(2, 2.1), text(1.2), text(2.2), other], topics) == 1


def test_one_image_twice_is_one() -> None:
    assert complete([image(1, 1.1), image(1, 1.2), text(1.3), text(1.4)], TOPICS) == 1


@given(st.lists(st.sampled_from("abc")))
def test_without_stamps_the_rarest_output_counts(topics: list[str]) -> None:
    arrivals = [Arrival(topic, at, 0, 1) for at, topic in enumerate(topics)]
    assert complete(arrivals, "abc") == min(topics.count(topic) for topic in "abc")


def test_a_set_is_as_old_as_its_last_output() -> None:
    assert ages_ms([image(1, 1.1), text(1.25)], TOPICS, [S]) == [pytest.approx(250)]
    assert ages_ms([text(1.1), image(1, 1.25)], TOPICS, [S]) == [pytest.approx(250)]


def test_what_has_no_stamp_counts_for_the_newest_image_before_it() -> None:
    arrivals = [image(1, 1.5), text(2.0), image(2, 2.25), text(2.5)]
    assert ages_ms(arrivals, TOPICS, [S, 2 * S]) == [pytest.approx(500)]
    assert ages_ms([text(0.9), image(1, 1.5)], TOPICS, [S]) == []


def test_sets_that_are_not_whole_have_no_age() -> None:
    assert ages_ms([image(1, 1.5), image(2, 2.25), text(2.5)], TOPICS, [S, 2 * S]) == [pytest.approx(500)]
    assert ages_ms([image(7, 7.5), text(7.75)], TOPICS, []) == []


def test_sizes_by_topic() -> None:
    assert mean_sizes([text(1, 10), text(2, 21), image(1, 1.1)]) == {"text": 16, "image": 100}
