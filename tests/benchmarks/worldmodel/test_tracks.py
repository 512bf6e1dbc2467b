"""Tracks that go by the objects of a world model."""

from collections.abc import Sequence

from benchmarks.accuracy.drives import HZ
from benchmarks.worldmodel.tracks import NEAR_S, named
from schemas.detections import Box, Detection

NEAR = round(NEAR_S * HZ)


def tracked(*tracks: int | None) -> list[Detection]:
    return [Detection(name="box", score=0.9, box=Box(0, 0, 9, 9), track=track) for track in tracks]


def names(
    tracks: Sequence[int | None],
    number: int,
    votes: dict[int, list[tuple[int, int]]],
    numbers: dict[tuple[str, int], int],
) -> list[int | None]:
    return [each.track for each in named(tracked(*tracks), number, votes, numbers)]


def test_two_tracks_of_one_object_are_one_and_a_track_of_two_is_each_where_it_is() -> None:
    votes = {1: [(0, 70), (1, 70)], 2: [(8, 70), (9, 70), (10, 70), (11, 80), (12, 80), (13, 80)]}
    numbers: dict[tuple[str, int], int] = {}
    first = names([1], 0, votes, numbers)
    assert names([2], 9, votes, numbers) == first
    assert names([2], 13, votes, numbers) != first
    assert set(numbers) == {("object", 70), ("object", 80)}


def test_an_object_is_given_once_in_an_image_and_others_keep_their_tracks() -> None:
    votes = {1: [(0, 70)], 2: [(0, 70), (1, 70)]}
    numbers: dict[tuple[str, int], int] = {}
    assert names([1, 2, 3, None], 0, votes, numbers) == [0, 1, 2, None]
    assert list(numbers) == [("track", 1), ("object", 70), ("track", 3)]


def test_what_a_track_was_long_ago_does_not_count() -> None:
    numbers: dict[tuple[str, int], int] = {}
    names([1], NEAR, {1: [(0, 70)]}, numbers)
    names([1], NEAR + 1, {1: [(0, 70)]}, numbers)
    assert list(numbers) == [("object", 70), ("track", 1)]
