import pytest

from services.detector.tracking.confirmed_tracks import MAX_TRACKS, NEUTRAL, ConfirmedTracks, neutral_score


@pytest.mark.parametrize(("score", "number"), [(NEUTRAL, None), (0.52, None), (0.53, 1), (1.0, 1)])
def test_one_sighting_is_enough_if_it_is_sure(score: float, number: int | None) -> None:
    assert ConfirmedTracks().weigh([(7, score)]) == [number]


def test_who_has_a_number_keeps_it_on_less_than_it_took_and_gets_it_back_on_as_little() -> None:
    evidence = ConfirmedTracks()
    scores = (0.6, NEUTRAL - 0.15, NEUTRAL - 0.15, NEUTRAL + 0.15)
    assert [evidence.weigh([(7, score)])[0] for score in scores] == [1, 1, None, 1]


def test_what_is_never_sure_never_earns_a_number() -> None:
    evidence = ConfirmedTracks()
    assert [evidence.weigh([(7, 0.3)]) for _ in range(50)] == [[None]] * 50


def test_a_doubtful_sighting_takes_no_number_from_what_was_seen_well_but_many_do() -> None:
    evidence = ConfirmedTracks()
    assert evidence.weigh([(7, 0.9)]) == [1]
    later = [evidence.weigh([(7, 0.26)])[0] for _ in range(10)]
    assert later[:3] == [1, 1, 1]
    assert later[-1] is None
    assert evidence.weigh([(7, 0.99)]) == [1]


def test_what_was_doubtful_at_first_earns_a_number_later() -> None:
    evidence = ConfirmedTracks()
    assert [evidence.weigh([(7, score)])[0] for score in (0.3, 0.35, 0.6)] == [None, None, 1]


def test_however_long_a_thing_was_seen_well_no_more_than_so_much_speaks_for_it() -> None:
    shortly, long = ConfirmedTracks(), ConfirmedTracks()
    for _ in range(2):
        shortly.weigh([(7, 1.0)])
    for _ in range(500):
        long.weigh([(7, 1.0)])
    assert [shortly.weigh([(7, 0.2)]) for _ in range(9)] == [long.weigh([(7, 0.2)]) for _ in range(9)]


def test_numbers_have_no_gaps_whatever_the_trackers_own_are() -> None:
    evidence = ConfirmedTracks()
    assert evidence.weigh([(70, 0.9), (71, 0.3), (95, 0.8)]) == [1, None, 2]
    assert evidence.weigh([(95, 0.8), (71, 0.9)]) == [2, 3]


def test_of_many_tracks_the_one_seen_longest_ago_is_forgotten() -> None:
    evidence = ConfirmedTracks()
    assert evidence.weigh((track, 0.9) for track in range(MAX_TRACKS + 1))[-1] == MAX_TRACKS + 1
    assert evidence.weigh([(1, 0.9), (0, 0.9)]) == [2, MAX_TRACKS + 2]


@pytest.mark.parametrize("score", [0.0, 1.0])
def test_scores_at_both_ends_are_taken(score: float) -> None:
    assert ConfirmedTracks().weigh([(1, score), (1, 0.5)])[0] == (1 if score else None)


@pytest.mark.parametrize("confidence", [0.0, 0.001, 0.05, 0.25, 0.5, 0.9, 1.0])
def test_of_a_model_that_is_not_known_whatever_is_reported_twice_has_a_number(confidence: float) -> None:
    evidence = ConfirmedTracks(neutral_score(confidence))
    numbers = [evidence.weigh([(7, confidence)])[0] for _ in range(200)]
    assert numbers == [None, *[1] * 199]
