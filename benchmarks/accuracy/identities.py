"""Whether what is followed keeps its identity: IDF1, and how often it does not. Pure.

IDF1 is that of Ristani et al., "Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking" (2016):
each true identity is given at most one track over the whole sequence, and each track at most one identity, so that as
many object-frames as possible are matched. A switch is what CLEAR MOT counts: an object's match is another track than
its last one, where a track that goes on is kept as long as it lies on the object.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import lap
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The identities and the tracks that are in a frame, and how well each lies on each.

    overlap: identities x tracks; 0 where the two cannot be a match.
    """

    identities: Sequence[int]
    tracks: Sequence[int]
    overlap: Floats


@dataclass(frozen=True, slots=True)
class Identities:
    """Sums over sequences, all but `switches` in object-frames.

    true, tracked: how many there were and how many there were tracks of. matched: the true ones that some track lies
    on. rightly: those that their own track lies on.
    """

    true: int = 0
    tracked: int = 0
    matched: int = 0
    rightly: int = 0
    switches: int = 0

    def __add__(self, other: "Identities") -> "Identities":
        return Identities(
            self.true + other.true,
            self.tracked + other.tracked,
            self.matched + other.matched,
            self.rightly + other.rightly,
            self.switches + other.switches,
        )

    @property
    def idf1(self) -> float | None:
        """Twice the rightly followed over all that was true and all that was tracked; None without either."""
        return _share(2 * self.rightly, self.true + self.tracked)

    @property
    def idp(self) -> float | None:
        """The share of what was tracked that was rightly followed."""
        return _share(self.rightly, self.tracked)

    @property
    def idr(self) -> float | None:
        """The share of what was true that was rightly followed."""
        return _share(self.rightly, self.true)

    @property
    def matched_f1(self) -> float | None:
        """What IDF1 would be if every match were of the right identity."""
        return _share(2 * self.matched, self.true + self.tracked)


def identities(frames: Iterable[Frame], least: float) -> Identities:
    """Score one sequence; an overlap of less than `least` is none."""
    together: Counter[tuple[int, int]] = Counter()
    last: dict[int, int] = {}
    true = tracked = matched = switches = 0
    for frame in frames:
        close = np.where(frame.overlap >= least, frame.overlap, 0.0)
        together.update((frame.identities[i], frame.tracks[j]) for i, j in np.argwhere(close > 0).tolist())
        pairs = [(frame.identities[i], frame.tracks[j]) for i, j in assigned(_kept(frame, close, last))]
        switches += sum(last.get(identity, track) != track for identity, track in pairs)
        last.update(pairs)
        matched += len(pairs)
        true += len(frame.identities)
        tracked += len(frame.tracks)
    return Identities(true, tracked, matched, _rightly(together), switches)


def assigned(weights: Floats) -> list[tuple[int, int]]:
    """Pair rows with columns, each at most once and at no weight of 0, so that the sum of the weights is greatest."""
    if not weights.size:
        return []
    _, columns, _ = lap.lapjv(weights.max() - weights, extend_cost=True)
    return [(row, column) for row, column in enumerate(columns.tolist()) if column >= 0 and weights[row, column] > 0]


def _kept(frame: Frame, close: Floats, last: dict[int, int]) -> Floats:
    """Return weights by which tracks that go on outweigh all others."""
    goes_on = np.array([[last.get(each) == track for track in frame.tracks] for each in frame.identities], np.bool_)
    return close + np.where(goes_on.reshape(close.shape) & (close > 0), float(min(close.shape, default=0)), 0.0)


def _rightly(together: Counter[tuple[int, int]]) -> int:
    """Return in how many object-frames a track lies on the one identity that it is given."""
    rows = {identity: n for n, identity in enumerate(dict.fromkeys(identity for identity, _ in together))}
    columns = {track: n for n, track in enumerate(dict.fromkeys(track for _, track in together))}
    counts = np.zeros((len(rows), len(columns)))
    for (identity, track), count in together.items():
        counts[rows[identity], columns[track]] = count
    return int(sum(counts[pair] for pair in assigned(counts)))


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None
