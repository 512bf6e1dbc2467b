"""Subjects of rules: their condition, their alert, and when the alert is due. Pure."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from heapq import heapify, heappop, heappush
from typing import Final
from zoneinfo import ZoneInfo

from msgspec.structs import replace

from schemas.alerts import MAX_TEXT, Alert, AlertState
from services.monitor.inventory.sighting import NS
from services.monitor.map.footprints import address_of_id
from services.monitor.rules.model import AnyRule, WorldRule

SubjectKey = tuple[str, str, str, str]
"""Robot, camera, class and object of an alert; each may be empty."""

SLACK: Final = 64
"""Stale heap entries tolerated, in addition to one per waiting entry."""


class PendingSubjects:
    """Places by rule, each until it is discarded; the cost per place hardly grows with their number.

    Places whose time has come are `ripe`: a rule that does not apply at this time of the day takes them later.
    """

    def __init__(self) -> None:
        self.ripe: dict[str, dict[SubjectKey, None]] = {}
        self._due: dict[tuple[str, SubjectKey], int] = {}
        self._queue: list[tuple[int, str, SubjectKey]] = []

    def add(self, rule: str, place: SubjectKey, due_ns: int) -> None:
        """Add a place that is due at a moment, epoch nanoseconds."""
        self._due[rule, place] = due_ns
        heappush(self._queue, (due_ns, rule, place))
        if len(self._queue) > 2 * len(self._due) + SLACK:
            self._rebuild()

    def discard(self, rule: str, place: SubjectKey) -> None:
        """Remove a place, if it waits."""
        self._due.pop((rule, place), None)
        if rule in self.ripe:
            self.ripe[rule].pop(place, None)
            if not self.ripe[rule]:
                del self.ripe[rule]

    def keep(self, rules: Collection[str]) -> None:
        """Remove the places of all other rules."""
        self._due = {key: due_ns for key, due_ns in self._due.items() if key[0] in rules}
        self.ripe = {rule: places for rule, places in self.ripe.items() if rule in rules}
        self._rebuild()

    def set_back(self, by_ns: int) -> None:
        """Make all due earlier by a duration."""
        self._due = {key: due_ns - by_ns for key, due_ns in self._due.items()}
        self._rebuild()

    def ripen(self, now_ns: int) -> None:
        """Advance time."""
        while self._queue and self._queue[0][0] <= now_ns:
            due_ns, rule, place = heappop(self._queue)
            if self._due.get((rule, place)) == due_ns:
                del self._due[rule, place]
                self.ripe.setdefault(rule, {})[place] = None

    def next_ns(self) -> int | None:
        """Return when the next place is due; None if none waits."""
        while self._queue and self._due.get(self._queue[0][1:]) != self._queue[0][0]:
            heappop(self._queue)
        return self._queue[0][0] if self._queue else None

    def _rebuild(self) -> None:
        self._queue = [(due_ns, rule, place) for (rule, place), due_ns in self._due.items()]
        heapify(self._queue)


class UnknownAlertError(Exception):
    """The alert does not exist, or is resolved already."""


@dataclass(frozen=True, slots=True)
class Effect:
    """A changed alert. rule: the one that raised it; None if it was removed. raised: it is new, so send the action.

    One that was over before it was known is not `raised`. escalated: it escalates, or had escalated before.
    """

    alert: Alert
    rule: AnyRule | None
    raised: bool
    escalated: bool = False


@dataclass(slots=True, eq=False)
class Subject:
    """One rule at one place. known: whether the condition holds is known, at least as of its last observation."""

    holds: bool = False
    known: bool = True
    since_ns: int = 0
    text: str = ""
    raised_ns: int | None = None
    alert: Alert | None = None


class Subjects:
    """The subjects of each rule. most: how many there may be; of more, those that come later are left out."""

    def __init__(self, rules: Iterable[str], most: int) -> None:
        self._most = most
        self._of: dict[str, dict[SubjectKey, Subject]] = {rule: {} for rule in rules}
        self._full = self._refused = False

    def __iter__(self) -> Iterator[tuple[str, SubjectKey, Subject]]:
        """Yield each with its rule and place."""
        return ((rule, place, each) for rule, subjects in self._of.items() for place, each in subjects.items())

    def get(self, rule: str, place: SubjectKey) -> Subject | None:
        """Return the subject of a rule at a place, if it is followed."""
        return self._of.get(rule, {}).get(place)

    def known(self, rule: str, place: SubjectKey) -> Subject:
        """Return one that is followed."""
        return self._of[rule][place]

    def take(self, rule: str, place: SubjectKey) -> Subject | None:
        """Return the subject of a rule at a place, a new one if need be; None if there is no room for it."""
        if place not in self._of[rule]:
            if not self._has_room():
                self._refused = True
                return None
            self._of[rule][place] = Subject()
        return self._of[rule][place]

    def drop(self, rule: str, place: SubjectKey) -> None:
        """Forget one that is followed."""
        del self._of[rule][place]

    def keep(self, same: Collection[str], rules: Iterable[str]) -> None:
        """Follow those of other rules. same: the rules whose subjects are kept."""
        self._of = {rule: self._of[rule] if rule in same else {} for rule in rules}
        self._full = self._refused = False

    def has_room_again(self) -> bool:
        """Whether there is room again for some that were left out, once: then all must be offered again."""
        if not self._refused or not self._has_room():
            return False
        self._refused = False
        return True

    def make_room_again(self) -> None:
        """Let those that are remembered for their cooldown alone make room, once until the next call."""
        self._full = False

    def _has_room(self) -> bool:
        if sum(map(len, self._of.values())) < self._most:
            return True
        if self._full:
            return False
        for rule, subjects in self._of.items():
            self._of[rule] = {place: subject for place, subject in subjects.items() if subject.holds}
        self._full = sum(map(len, self._of.values())) >= self._most
        return not self._full


def linked(alert: Alert, page: str) -> Alert:
    """Return an alert with the address of its object's page, if it is about one. page: where pages are, or empty."""
    return replace(alert, link=page + address_of_id(alert.site, alert.object)) if alert.object else alert


def new_alert(alert_id: str, rule: AnyRule, place: SubjectKey, text: str, now_ns: int) -> Alert:
    """Return an alert that is raised now."""
    robot, camera, name, object_id = place
    return Alert(
        id=alert_id,
        rule=rule.name,
        severity=rule.severity,
        state=AlertState.RAISED,
        robot=robot,
        camera=camera,
        name=name,
        site=rule.site if isinstance(rule, WorldRule) else "",
        object=object_id,
        text=text[:MAX_TEXT],
        raised_ns=now_ns,
        changed_ns=now_ns,
    )


def local_time(now_ns: int, timezone: str | None) -> datetime:
    utc = datetime.fromtimestamp(now_ns / NS, UTC)
    return utc.astimezone(ZoneInfo(timezone) if timezone else None)


def had_escalated(alert: Alert, rule: AnyRule | None) -> bool:
    """Whether an alert has escalated, or was acknowledged only after its escalation time."""
    if rule is None or rule.escalate_after_s is None:
        return alert.state is AlertState.ESCALATED
    due_ns = alert.raised_ns + round(rule.escalate_after_s * NS)
    return alert.state is AlertState.ESCALATED or alert.changed_ns >= due_ns


def set_back(alert: Alert, now_ns: int, by_ns: int) -> Alert:
    """Return the alert, raised no later than now."""
    if alert.raised_ns <= now_ns:
        return alert
    return replace(alert, raised_ns=alert.raised_ns - by_ns, changed_ns=alert.changed_ns - by_ns)
