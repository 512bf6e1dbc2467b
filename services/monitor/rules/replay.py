"""Rules tried against history: which alerts they would have raised. Pure."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count, groupby
from typing import Final

from schemas.keys import CameraKey
from services.monitor.history.intervals import Interval
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting
from services.monitor.rules.conditions import Look
from services.monitor.rules.engine import Effect, RuleEngine
from services.monitor.rules.model import DisagreeRule, NearerRule, RuleBook, SilentRule

UNTRIED: Final = "is not tried: history does not hold what it is about"
AT_MOST: Final = "is tried with the nearest distance of each interval, so it may have been raised less often"


@dataclass(slots=True)
class _Camera:
    counts: dict[str, int] = field(default_factory=dict)
    nearest: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Step:
    """An interval begins or ends; first: nobody saw it begin, as nothing is kept of the camera before."""

    at_ns: int
    interval: Interval
    begins: bool
    first: bool = False


def caveats(book: RuleBook) -> list[str]:
    """Return what a replay of these rules cannot tell."""
    notes = {rule.name: UNTRIED for rule in book.rules if isinstance(rule, SilentRule | DisagreeRule)}
    notes.update({rule.name: AT_MOST for rule in book.rules if isinstance(rule, NearerRule)})
    return [f"{name}: {note}" for name, note in notes.items()]


def replay(book: RuleBook, intervals: Sequence[Interval]) -> Iterator[Effect]:
    """Yield what the rules would have made of what was seen, in order."""
    numbers = count(1)
    tried = RuleBook(
        rules=tuple(rule for rule in book.rules if not isinstance(rule, SilentRule | DisagreeRule)),
        webhooks=book.webhooks,
        timezone=book.timezone,
    )
    engine = RuleEngine(tried, lambda: str(next(numbers)))
    cameras: dict[CameraKey, _Camera] = {}
    for at_ns, steps in groupby(_steps(intervals), key=lambda step: step.at_ns):
        yield from _until(engine, at_ns)
        some = list(steps)
        for step in some:
            _apply(step, cameras.setdefault(step.interval.key, _Camera()))
        engine.changed(_changes(some, cameras), at_ns)
        for key in {step.interval.key for step in some}:
            camera = cameras[key]
            engine.look(Look(key, speaks=True, counts=camera.counts, nearest=camera.nearest), at_ns)
        yield from engine.due(at_ns)
    last_ns = max((interval.until_ns for interval in intervals), default=0)
    yield from _until(engine, last_ns + 1)


def _until(engine: RuleEngine, at_ns: int) -> Iterator[Effect]:
    """Let time pass up to a moment, stopping wherever something that is waited for may be due."""
    last_ns = -1
    while (next_ns := engine.next_ns()) is not None and last_ns < next_ns < at_ns:
        last_ns = next_ns
        yield from engine.due(next_ns)


def _steps(intervals: Iterable[Interval]) -> list[_Step]:
    began: dict[CameraKey, int] = {}
    for interval in intervals:
        began[interval.key] = min(interval.since_ns, began.get(interval.key, interval.since_ns))
    steps = []
    for interval in intervals:
        first = interval.since_ns == began[interval.key]
        steps.append(_Step(interval.since_ns, interval, begins=True, first=first))
        if not interval.open:
            steps.append(_Step(interval.until_ns, interval, begins=False))
    return sorted(steps, key=lambda step: (step.at_ns, step.begins))


def _apply(step: _Step, camera: _Camera) -> None:
    name, closest_m = step.interval.name, step.interval.closest_m
    camera.counts[name] = step.interval.count if step.begins else 0
    camera.nearest.pop(name, None)
    if step.begins and closest_m is not None:
        camera.nearest[name] = closest_m


def _changes(steps: Iterable[_Step], cameras: dict[CameraKey, _Camera]) -> Iterator[Change]:
    """Yield what came and went: an interval that begins where one of the same class ends is another count of it."""
    some = list(steps)
    ended = {step.interval.place for step in some if not step.begins}
    began = {step.interval.place for step in some if step.begins}
    for step in some:
        if step.interval.place in ended & began:
            continue
        sighting = _sighting(step.interval, cameras[step.interval.key].counts[step.interval.name])
        kind = ChangeKind.APPEARED if step.begins else ChangeKind.VANISHED
        yield Change(kind, sighting, step.at_ns, first_look=step.first)


def _sighting(interval: Interval, seen: int) -> Sighting:
    return Sighting(
        key=interval.key,
        name=interval.name,
        count=seen,
        score=interval.score,
        first_ns=interval.first_ns,
        since_ns=interval.since_ns,
        last_ns=interval.until_ns,
        model=interval.model,
        worker=interval.worker,
    )
