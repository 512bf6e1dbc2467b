"""Replays rules over the history: which alerts they would have raised. Pure."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count, groupby
from typing import Final

from schemas.alerts import Alert
from schemas.keys import CameraKey
from services.monitor.history.intervals import Disagreement, Interval
from services.monitor.history.presence import RESTORED_NS, Presence
from services.monitor.inventory.sighting import Change, ChangeKind, Sighting
from services.monitor.liveness import SETTLE_NS
from services.monitor.rules.engine import RuleEngine
from services.monitor.rules.findings import CameraState
from services.monitor.rules.model import NearerRule, RuleBook, WorldRule
from services.monitor.rules.subjects import Effect
from services.monitor.rules.timeline import Run, Step, Timeline

AT_MOST: Final = "is tried with the nearest distance of each interval, so the monitor may have raised it less often"


NOT_AT_ALL: Final = "is not tried, as the history has no objects of sites"


@dataclass(slots=True)
class _Robot:
    there: bool
    last_ns: int


@dataclass(slots=True)
class _Camera:
    """available: None while it is unknown whether it ever was available."""

    counts: dict[str, int] = field(default_factory=dict)
    nearest: dict[str, float] = field(default_factory=dict)
    disagreements: dict[str, tuple[int, int]] = field(default_factory=dict)
    available: bool | None = None
    last_ns: int = 0

    @property
    def goes_on(self) -> bool:
        return bool(self.available) or any(self.counts.values())


class _Memory:
    """A monitor's knowledge of the fleet; last_ns: a member's newest message."""

    def __init__(self) -> None:
        self.robots: dict[str, _Robot] = {}
        self.cameras: dict[CameraKey, _Camera] = {}

    def take(self, step: Step) -> None:
        match step.of:
            case Interval() as of:
                _see(self._camera(of.key, step.at_ns), of, begins=step.begins)
            case Presence(camera="") as of:
                self.robots[of.robot] = _Robot(step.begins, step.at_ns)
            case Presence() as of:
                self._camera(CameraKey(of.robot, of.camera), step.at_ns).available = step.begins
            case Disagreement() as of:
                _dispute(self._camera(of.key, step.at_ns), of, begins=step.begins)

    def forget(self, before_ns: int) -> None:
        """Forget robots and cameras that were gone before, as a starting monitor does."""
        robots, cameras = self.robots.items(), self.cameras.items()
        self.robots = {name: of for name, of in robots if of.there or of.last_ns >= before_ns}
        self.cameras = {key: of for key, of in cameras if of.goes_on or of.last_ns >= before_ns}

    def _camera(self, key: CameraKey, at_ns: int) -> _Camera:
        camera = self.cameras.setdefault(key, _Camera())
        camera.last_ns = at_ns
        return camera


def caveats(book: RuleBook) -> list[str]:
    """Return the limits of a replay of these rules."""
    limits = {rule.name: AT_MOST for rule in book.rules if isinstance(rule, NearerRule)}
    limits |= {rule.name: NOT_AT_ALL for rule in book.rules if isinstance(rule, WorldRule)}
    return [f"{rule.name}: {limits[rule.name]}" for rule in book.rules if rule.name in limits]


def replay(book: RuleBook, past: Timeline) -> Iterator[Effect]:
    """Yield the alerts' changes over the history, in order; nothing changes while no monitor ran."""
    numbers = count(1)
    memory, steps = _Memory(), deque(past.steps())
    alerts: list[Alert] = []
    before_ns = 0
    for run in past.runs():
        for step in _taken(steps, run.since_ns):
            memory.take(step)
        memory.forget(min(before_ns, run.since_ns - RESTORED_NS))
        engine = RuleEngine(book, lambda: str(next(numbers)))
        engine.restore(alerts, run.since_ns)
        before_ns = min(run.until_ns, past.last_ns + 1)
        yield from _run(engine, run, _taken(steps, run.until_ns), memory, before_ns)
        alerts = engine.alerts()


def _taken(steps: deque[Step], until_ns: int) -> list[Step]:
    """Take away the steps before a moment."""
    taken = []
    while steps and steps[0].at_ns < until_ns:
        taken.append(steps.popleft())
    return taken


def _run(engine: RuleEngine, run: Run, steps: Sequence[Step], memory: _Memory, until_ns: int) -> Iterator[Effect]:
    """Yield what became of one run. Only a while after its beginning it is known who is there."""
    settled_ns = run.since_ns + SETTLE_NS if run.told else 0
    if settled_ns < until_ns and run.told:
        steps = sorted([*steps, Step(settled_ns, None)], key=lambda step: step.at_ns)
    now_ns = run.since_ns
    yield from engine.due(now_ns)
    for at_ns, group in groupby(steps, key=lambda step: step.at_ns):
        yield from _until(engine, now_ns, at_ns)
        now_ns = at_ns
        some = list(group)
        for step in some:
            memory.take(step)
        engine.changed(_changes(some, memory), at_ns)
        if at_ns >= settled_ns:
            _look(engine, some, memory, at_ns, told=run.told)
        yield from engine.due(at_ns)
    yield from _until(engine, now_ns, until_ns)


def _until(engine: RuleEngine, now_ns: int, at_ns: int) -> Iterator[Effect]:
    """Let time pass from now up to a moment, stopping wherever something that is waited for may be due."""
    while (next_ns := engine.next_ns(now_ns)) is not None and next_ns < at_ns:
        now_ns = next_ns
        yield from engine.due(now_ns)


def _look(engine: RuleEngine, steps: Iterable[Step], memory: _Memory, at_ns: int, *, told: bool) -> None:
    """Evaluate the subjects of the steps. told: presence is known."""
    for key in {key for step in steps for key in _cameras(step, memory)}:
        of = memory.cameras[key]
        available = of.available is not False or not told
        disagreements = of.disagreements if told else {}
        silent_ns = None if available else at_ns
        look = CameraState(key, available, silent_ns, counts=of.counts, nearest=of.nearest, disagreements=disagreements)
        engine.look(look, at_ns)
    for name in {name for step in steps for name in _robots(step, memory)} if told else ():
        engine.robot(name, alive=memory.robots[name].there, now_ns=at_ns)


def _cameras(step: Step, memory: _Memory) -> Iterable[CameraKey]:
    match step.of:
        case None:
            return memory.cameras
        case Interval() | Disagreement() as of:
            return (of.key,)
        case Presence(camera=camera) as of if camera:
            return (CameraKey(of.robot, camera),)
    return ()


def _robots(step: Step, memory: _Memory) -> Iterable[str]:
    match step.of:
        case None:
            return memory.robots
        case Presence(camera="") as of:
            return (of.robot,)
    return ()


def _see(camera: _Camera, interval: Interval, *, begins: bool) -> None:
    name, closest_m = interval.name, interval.closest_m
    camera.counts[name] = interval.count if begins else 0
    camera.nearest.pop(name, None)
    if begins and closest_m is not None:
        camera.nearest[name] = closest_m


def _dispute(camera: _Camera, of: Disagreement, *, begins: bool) -> None:
    camera.counts.setdefault(of.name, of.count)  # its beginning may be outside the period read
    camera.disagreements.pop(of.name, None)
    if begins:
        camera.disagreements[of.name] = (of.count, of.other_count)


def _changes(steps: Iterable[Step], memory: _Memory) -> Iterator[Change]:
    """Yield appearances and disappearances: an interval that follows one of the same class only changes the count."""
    some = [(step, step.of) for step in steps if isinstance(step.of, Interval) and (step.begins or not step.unseen)]
    ended = {of.place for step, of in some if not step.begins}
    began = {of.place for step, of in some if step.begins}
    for step, of in some:
        if of.place in ended & began:
            continue
        sighting = _sighting(of, memory.cameras[of.key].counts[of.name], of.since_ns if step.begins else step.at_ns)
        kind = ChangeKind.APPEARED if step.begins else ChangeKind.VANISHED
        yield Change(kind, sighting, first_look=step.unseen)


def _sighting(interval: Interval, seen: int, since_ns: int) -> Sighting:
    return Sighting(
        key=interval.key,
        name=interval.name,
        count=seen,
        score=interval.score,
        first_ns=interval.first_ns,
        since_ns=since_ns,
        last_ns=interval.until_ns,
        model=interval.model,
        worker=interval.worker,
    )
