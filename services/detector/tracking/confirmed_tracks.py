"""Decides which tracks are confirmed and get a number. Pure.

An object that is seen again and again gathers evidence, as tracks do in multiple hypothesis tracking (Reid, "An
Algorithm for Tracking Multiple Targets", 1979; its score of a track is the sum of log-likelihood ratios): each sighting
adds the log odds of its score, less those of a score that speaks neither for an object nor against it. A high score
gives a number at first sight, lower ones after several sightings, and the track keeps it until more sightings speak
against it. So an object that flickers with low scores never gets a number, and one doubtful sighting takes none from
one seen well.
"""

import math
from collections import OrderedDict
from collections.abc import Iterable
from typing import Final

NEUTRAL: Final = 0.33
"""The score at which, on simulated drives, two in five detections of the shipped model are right: about half the F1
that is reached there, which is the chance from which on it pays to count one in (Lipton et al., "Optimal Thresholding
of Classifiers to Maximize F1 Measure", 2014)."""

ENOUGH: Final = 0.8
"""Evidence that a track needs for its number: one sighting at a score of 0.53, or several that are less sure."""

LEEWAY: Final = ENOUGH / 2 + 0.01
"""By how much in log odds the least score that is reported speaks for a thing, where the model is not known: two
sightings are enough for a number."""

SUREST: Final = 0.98
"""Score that a single sighting counts as at most: a model that says 1 is not infinitely sure."""

LEAST: Final = 1 - SUREST
"""Score that a single sighting counts as at least."""

MOST: Final = 3.0
"""Evidence of a track at most, so that it can soon lose its number if it slides onto another object."""

MAX_TRACKS: Final = 10_000
"""Tracks remembered; those seen longest ago are forgotten first."""


class ConfirmedTracks:
    """Assigns numbers, from 1 on without gaps, to a tracker's tracks once they are confirmed.

    neutral: the score, between 0 and 1, that speaks neither for a thing nor against it.
    """

    def __init__(self, neutral: float = NEUTRAL) -> None:
        self.neutral = neutral
        self._sums: OrderedDict[int, float] = OrderedDict()
        self._numbers: dict[int, int] = {}
        self._count = 0

    def weigh(self, sightings: Iterable[tuple[int, float]]) -> list[int | None]:
        """Take a frame's sightings (a tracker's own number, the score, 0 to 1); return each one's number, or None."""
        return [self._weighed(track, score) for track, score in sightings]

    def _weighed(self, track: int, score: float) -> int | None:
        gathered = min(MOST, self._sums.pop(track, 0.0) + _log_odds(_clipped(score)) - _log_odds(self.neutral))
        self._sums[track] = gathered
        if len(self._sums) > MAX_TRACKS:
            forgotten, _ = self._sums.popitem(last=False)
            self._numbers.pop(forgotten, None)
        if gathered < (0 if track in self._numbers else ENOUGH):
            return None
        if track not in self._numbers:
            self._count += 1
            self._numbers[track] = self._count
        return self._numbers[track]


def neutral_score(confidence: float) -> float:
    """Return the neutral score of a model of which only the minimum reported score is known; see LEEWAY."""
    return 1 / (1 + math.exp(LEEWAY - _log_odds(_clipped(confidence))))


def _clipped(score: float) -> float:
    return min(max(score, LEAST), SUREST)


def _log_odds(score: float) -> float:
    return math.log(score / (1 - score))
