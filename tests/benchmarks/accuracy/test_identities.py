from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from benchmarks.accuracy.identities import Frame, Identities, assigned, identities

LEAST = 0.5


def frame(**pairs: int | None) -> Frame:
    """Return a frame: a=7 is object a under track 7, a=None is missed, and _8=8 is a track of nothing."""
    names = [name for name in pairs if not name.startswith("_")]
    tracks = [track for track in pairs.values() if track is not None]
    overlap = np.array([[0.8 * (pairs[name] == track) for track in tracks] for name in names])
    return Frame([ord(name) for name in names], tracks, overlap.reshape(len(names), len(tracks)))


def test_everything_right() -> None:
    found = identities([frame(a=1, b=2)] * 4, LEAST)
    assert found == Identities(true=8, tracked=8, matched=8, rightly=8, switches=0)
    assert (found.idf1, found.idp, found.idr, found.matched_f1) == (1, 1, 1, 1)


def test_a_fragmented_track_counts_with_its_longer_part() -> None:
    found = identities([frame(a=1)] * 3 + [frame(a=2)] * 7, LEAST)
    assert found == Identities(true=10, tracked=10, matched=10, rightly=7, switches=1)
    assert (found.idf1, found.idp, found.idr, found.matched_f1) == (0.7, 0.7, 0.7, 1)


def test_two_objects_that_swap_their_tracks() -> None:
    found = identities([frame(a=1, b=2)] * 6 + [frame(a=2, b=1)] * 4, LEAST)
    assert (found.rightly, found.switches, found.idf1) == (12, 2, 0.6)


def test_a_track_that_goes_over_to_another_object_is_right_on_one_of_them() -> None:
    found = identities([frame(a=1, b=None)] * 4 + [frame(a=None, b=1)] * 6, LEAST)
    assert found == Identities(true=20, tracked=10, matched=10, rightly=6, switches=0)
    assert (found.idf1, found.idp, found.idr) == (0.4, 0.6, 0.3)


def test_what_is_missed_lowers_recall_alone() -> None:
    found = identities([frame(a=1)] * 6 + [frame(a=None)] * 2 + [frame(a=1)] * 2, LEAST)
    assert (found.idp, found.idr, found.switches) == (1, 0.8, 0)
    assert found.idf1 == pytest.approx(16 / 18)


def test_what_is_invented_lowers_precision_alone() -> None:
    found = identities([frame(a=1)] * 6 + [frame(a=1, _8=8)] * 4, LEAST)
    assert (found.idp, found.idr) == (10 / 14, 1)
    assert found.idf1 == pytest.approx(20 / 24)
    assert found.matched_f1 == found.idf1


def test_an_identity_is_assigned_over_the_whole_sequence_not_frame_by_frame() -> None:
    """Track 1 lies on a for the longest; together they match most when a takes track 2 and b takes 1."""
    found = identities([frame(a=1, b=None)] * 5 + [frame(a=2, b=None)] * 4 + [frame(a=None, b=1)] * 4, LEAST)
    assert found.rightly == 8


def test_a_track_that_goes_on_is_no_switch_though_another_lies_better() -> None:
    both = Frame([1], [10, 11], np.array([[0.6, 0.9]]))
    found = identities([Frame([1], [10], np.array([[0.9]])), both, both], LEAST)
    assert (found.switches, found.matched, found.tracked, found.rightly) == (0, 3, 5, 3)


@pytest.mark.parametrize(("overlap", "right"), [(0.5, 1), (0.4999, 0)])
def test_less_than_the_least_overlap_is_none(overlap: float, right: int) -> None:
    found = identities([Frame([1], [5], np.array([[overlap]]))], LEAST)
    assert (found.rightly, found.matched) == (right, right)


def test_a_switch_after_a_gap_counts() -> None:
    assert identities([frame(a=1), frame(a=None), frame(), frame(a=2)], LEAST).switches == 1


def test_of_nothing_there_is_no_share() -> None:
    found = identities([frame(), frame()], LEAST)
    assert (found.idf1, found.idp, found.idr, found.matched_f1) == (None, None, None, None)
    assert identities([frame(a=None)], LEAST).idf1 == 0
    assert identities([frame(_8=8)], LEAST).idf1 == 0


def test_sequences_add_up_and_share_no_identity() -> None:
    one, other = identities([frame(a=1)] * 3, LEAST), identities([frame(a=2)] * 7, LEAST)
    assert one + other == Identities(true=10, tracked=10, matched=10, rightly=10, switches=0)


WEIGHTS = arrays.arrays(
    np.float64,
    st.tuples(st.integers(0, 5), st.integers(0, 5)),
    elements=st.sampled_from([0.0, 0.5, 0.75, 1.0, 3.0, 20.0]),
)


@given(WEIGHTS)
def test_no_other_pairing_has_a_greater_sum(weights: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    pairs = assigned(weights)
    rows, columns = weights.shape
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(pairs)
    assert all(weights[pair] > 0 for pair in pairs)
    padded = np.zeros((max(rows, columns), max(rows, columns)))
    padded[:rows, :columns] = weights
    best = max(sum(padded[n, column] for n, column in enumerate(order)) for order in permutations(range(len(padded))))
    assert sum(weights[pair] for pair in pairs) == best
