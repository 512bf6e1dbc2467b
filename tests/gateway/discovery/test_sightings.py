from collections.abc import Sequence

from gateway.discovery.published_topics import HOLD_S, MAX_GAP_S, Topic, TopicHistory
from tests.gateway.discovery.graphs import IMAGE, POINTS, graph

FRONT, REAR = graph({IMAGE: "/front/image_raw /rear/image_raw"})


def looks(
    sightings: TopicHistory, topics: Sequence[Topic], seconds: int, *, begin: int, life: str | None = None
) -> int:
    """Look once a second, `seconds` times; return when the next look would be."""
    for now in range(begin, begin + seconds):
        sightings.see(topics, now, life)
    return begin + seconds


def test_what_is_gone_counts_until_its_node_had_time_to_restart() -> None:
    sightings = TopicHistory()
    sightings.see([FRONT, REAR], 100)
    looks(sightings, [REAR], 29, begin=101)
    assert sightings.topics() == [FRONT, REAR]
    sightings.see([REAR], 100 + HOLD_S)
    assert sightings.topics() == [REAR]


def test_who_comes_back_in_time_counts_anew() -> None:
    sightings = TopicHistory()
    sightings.see([FRONT], 0)
    begin = looks(sightings, [], 29, begin=1)
    begin = looks(sightings, [FRONT], 1, begin=begin)
    looks(sightings, [], 29, begin=begin)
    assert sightings.topics() == [FRONT]


def test_time_without_a_master_does_not_count() -> None:
    sightings = TopicHistory()
    sightings.see([FRONT], 0)
    sightings.see([], 1000)
    assert sightings.topics() == [FRONT]
    sightings.see([], 1000 + HOLD_S)
    assert sightings.topics() == [FRONT]
    begin = looks(sightings, [], int(HOLD_S - 2 * MAX_GAP_S) - 1, begin=1001 + int(HOLD_S))
    assert sightings.topics() == [FRONT]
    looks(sightings, [], 1, begin=begin)
    assert sightings.topics() == []


def test_what_a_new_master_has_not_heard_of_counts_until_it_has() -> None:
    sightings = TopicHistory()
    sightings.see([FRONT, REAR], 0, "first")
    begin = looks(sightings, [], 1000, begin=1, life="second")
    assert sightings.topics() == [FRONT, REAR]
    begin = looks(sightings, [FRONT], 1, begin=begin, life="second")
    looks(sightings, [], 30, begin=begin, life="second")
    assert sightings.topics() == [REAR]


def test_the_type_and_the_publishers_are_the_latest() -> None:
    sightings = TopicHistory()
    changed = Topic(FRONT.name, POINTS, ("/other",))
    sightings.see([FRONT], 0)
    sightings.see([changed], 1)
    assert sightings.topics() == [changed]


def test_a_gateway_that_goes_on_publishing_does_not_take_a_sensors_place() -> None:
    sightings = TopicHistory()
    left = Topic(FRONT.name, IMAGE, ("/fleetsight_gateway_r2_0",))
    sightings.see([left], 0)
    assert sightings.topics() == [left]
    sightings.see([FRONT], 1)
    looks(sightings, [left], 29, begin=2)
    assert sightings.topics() == [FRONT]
    looks(sightings, [left], 2, begin=31)
    assert sightings.topics() == [left]
