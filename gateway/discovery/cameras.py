"""Which candidates belong to one camera, and which of them are its streams."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from gateway.discovery.candidates import Candidate, is_rectified_color
from gateway.discovery.reading import Path
from schemas.keys import Stream

SIDES: Final = ("left", "stereo", "right")
"""The last chunk of what is a part of a camera if the rest of it is a camera too; the preferred one first."""


def with_sides_joined(candidates: Sequence[Candidate], given: Mapping[Path, str]) -> list[Candidate]:
    """Return the candidates with both sides of a stereo camera as one camera.

    Two sides of which there is nothing in common are two cameras, and stay it: `given` are the cameras with a name.
    """
    whole = {candidate.path for candidate in candidates} | given.keys()
    return [_joined(candidate, whole, given) for candidate in candidates]


def _joined(candidate: Candidate, whole: Iterable[Path], given: Mapping[Path, str]) -> Candidate:
    *parent, side = candidate.path or ("",)
    if side not in SIDES or tuple(parent) not in whole or candidate.path in given:
        return candidate
    return replace(candidate, path=tuple(parent), rank=(1 + SIDES.index(side), *candidate.rank[1:]))


def rectified_first(colors: Sequence[Candidate]) -> list[Candidate]:
    """Return a camera's candidates for colour with the rectified ones of the preferred side first."""
    side = colors[0].rank[0]
    return sorted(colors, key=lambda each: not (each.rank[0] == side and is_rectified_color(each)))


def best(candidates: Iterable[Candidate], names: Mapping[Path, str]) -> dict[tuple[str, Stream], list[Candidate]]:
    """Return by camera and stream who could be it, the preferred one first."""
    slots: dict[tuple[str, Stream], list[Candidate]] = {}
    for candidate in sorted(candidates, key=lambda each: each.rank):
        slots.setdefault((names[candidate.path], candidate.stream), []).append(candidate)
    return dict(sorted(slots.items()))
