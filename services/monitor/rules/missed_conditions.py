"""Conditions that came and went before anybody looked, as while the monitor was away or held up. Pure.

`RuleEngine` looks at cameras ten times a second. Class lists that come late, from robots that keep them while nobody
hears them, may tell at once that something came and that it went. Its alert is raised and resolved afterwards, with its
own times and without an action: there is nothing left to act on.
"""

from collections.abc import Callable, Collection, Iterator
from typing import Final, NamedTuple

from msgspec.structs import replace

from schemas.alerts import AlertState
from services.monitor.inventory.sighting import NS, Change, ChangeKind
from services.monitor.rules.engine import RuleEngine
from services.monitor.rules.findings import found_in
from services.monitor.rules.model import AnyRule, opening_ns
from services.monitor.rules.subjects import Effect, SubjectKey, linked, local_time, new_alert

MAX_BEGUN: Final = 100_000
"""Maximum number of conditions that are followed; the oldest are given up for newer ones."""

LOOK_NS: Final = NS // 2
"""How long, in nanoseconds, a condition holds until an engine that is not held up has looked at it."""


class _Begun(NamedTuple):
    """Since when a condition holds, when that became known, and the alert's text."""

    since_ns: int
    taken_ns: int
    text: str


class MissedConditions:
    """Finds them in changes of what is in view: of rules of the kinds appears, disappears, over and under.

    new_id: names alerts. page: where the monitor's pages are, for links to objects.
    """

    def __init__(self, new_id: Callable[[], str], *, page: str = "") -> None:
        self._new_id = new_id
        self._page = page
        self._begun: dict[tuple[str, SubjectKey], _Begun] = {}

    def clear(self) -> None:
        """Forget all of them."""
        self._begun.clear()

    def forget(self, cameras: Collection[tuple[str, str]]) -> None:
        """Forget robots' cameras."""
        for key in [key for key in self._begun if key[1][:2] in cameras]:
            del self._begun[key]

    def take(self, change: Change, engine: RuleEngine, now_ns: int, *, late: bool) -> Iterator[Effect]:
        """Take a change that the engine is not told of yet; yield what becomes of the alerts of passed conditions.

        late: it tells of a while ago. If so, or if what began is over too soon, the engine could not look in time. Else
        it raised what was to be raised.
        """
        of = change.sighting
        for rule in engine.rules_of(of.key):
            place = (of.key.robot, of.key.camera, of.name, "")
            key = (rule.name, place)
            if change.kind is ChangeKind.LOST or change.first_look:
                self._begun.pop(key, None)  # nobody looked meanwhile
            found = found_in(change, rule)
            if found is None:
                continue
            if found.since_ns is not None:
                self._begin(key, _Begun(found.since_ns, now_ns, found.text), engine)
                continue
            begun = self._begun.pop(key, None)
            raised_ns = engine.end(rule, place, now_ns)
            if begun is None or found.until_ns is None or (raised_ns is not None and raised_ns >= begun.since_ns):
                continue
            if late or begun.taken_ns > now_ns - round(rule.for_s * NS) - LOOK_NS:
                yield from self._passed(rule, place, begun, found.until_ns, engine)

    def _begin(self, key: tuple[str, SubjectKey], new: _Begun, engine: RuleEngine) -> None:
        first = self._begun.get(key)
        if first is None:
            if len(self._begun) >= MAX_BEGUN:
                del self._begun[next(iter(self._begun))]
            subject = engine.subject(*key)
            known_ns = new.since_ns if subject is None or not subject.holds else subject.since_ns
            first = new._replace(since_ns=min(new.since_ns, known_ns))
        self._begun[key] = first._replace(text=new.text)

    def _passed(
        self, rule: AnyRule, place: SubjectKey, begun: _Begun, until_ns: int, engine: RuleEngine
    ) -> Iterator[Effect]:
        due_ns = begun.since_ns + round(rule.for_s * NS)
        subject = engine.subject(rule.name, place)
        if subject is not None and subject.raised_ns is not None:
            due_ns = max(due_ns, subject.raised_ns + round(rule.cooldown_s * NS))
        while due_ns <= until_ns and not rule.applies_at(local_time(due_ns, engine.book.timezone)):
            due_ns = opening_ns(rule, due_ns)
        if due_ns > until_ns:
            return
        engine.note_raised(rule, place, due_ns)
        raised = linked(new_alert(self._new_id(), rule, place, begun.text, due_ns), self._page)
        over = replace(raised, state=AlertState.RESOLVED, changed_ns=max(until_ns, due_ns + 1))
        yield from (Effect(alert, rule, raised=False) for alert in (raised, over))
