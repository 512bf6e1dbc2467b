"""Applies rules over time: hold times, cooldowns and the states of alerts. Pure."""

from collections.abc import Callable, Collection, Container, Iterable, Iterator
from typing import Final, cast

import msgspec

from schemas.alerts import Alert, AlertState
from schemas.keys import CameraKey
from services.monitor.inventory.sighting import NS, Change
from services.monitor.rules import alert_texts, model
from services.monitor.rules.findings import CameraState, Finding, findings, found_in
from services.monitor.rules.model import (
    AnyRule,
    AppearsRule,
    DisagreeRule,
    DisappearsRule,
    RuleBook,
    SilentRule,
    WorldRule,
)
from services.monitor.rules.subjects import (
    Effect,
    PendingSubjects,
    Subject,
    SubjectKey,
    Subjects,
    UnknownAlertError,
    had_escalated,
    linked,
    local_time,
    new_alert,
    set_back,
)

MAX_SUBJECTS: Final = 100_000
"""Maximum number of robots, cameras and classes followed over all rules together."""


class RuleEngine:
    """Applies a rule book to changes. Times are epoch nanoseconds of the monitor's clock, which may be set back.

    new_id: names alerts. most: subjects that are followed; of more, those that come later are left out.
    page: where the monitor's pages are, for links to objects.
    Fetch results with `due` after all inputs.
    """

    def __init__(self, book: RuleBook, new_id: Callable[[], str], *, most: int = MAX_SUBJECTS, page: str = "") -> None:
        self._new_id = new_id
        self._page = page
        self._book = book
        self._subjects = Subjects((rule.name for rule in book.rules), most)
        self._waiting = PendingSubjects()
        self._alerts: dict[str, tuple[Alert, SubjectKey]] = {}
        self._escalated: set[str] = set()
        self._effects: list[Effect] = []
        self._cameras: dict[tuple[str, str], list[AnyRule]] = {}
        self._robots: dict[str, list[SilentRule]] = {}
        self._unknown: set[tuple[str, str]] = set()
        self._inherited: dict[tuple[str, str], set[str]] = {}
        self._now_ns = 0

    @property
    def book(self) -> RuleBook:
        """The rules that are in force."""
        return self._book

    def alerts(self) -> list[Alert]:
        """Return the unresolved alerts in their current state."""
        return [alert for alert, _ in self._alerts.values()]

    def replace(self, book: RuleBook, now_ns: int) -> None:
        """Put other rules in force. Unchanged rules continue; the alerts of removed ones resolve."""
        before = {rule.name: rule for rule in self._book.rules}
        same = {rule.name for rule in book.rules if model.same_rule(rule, before.get(rule.name))}
        for alert, _ in list(self._alerts.values()):
            if alert.rule not in same:
                self._change(alert, AlertState.RESOLVED, now_ns)
        self._book = book
        self._subjects.keep(same, (rule.name for rule in book.rules))
        self._waiting.keep(same)
        self._cameras.clear()
        self._robots.clear()

    def restore(self, alerts: Iterable[Alert], now_ns: int, escalated: Container[str] = ()) -> None:
        """Continue with the alerts of an earlier monitor.

        Those resolve that are double, and those of rules that are gone or, by now, about something else. One that was
        acknowledged only after it was to escalate is taken to have done so, too.

        escalated: the ids of those that somebody had escalate.
        """
        self._advance(now_ns)
        rules = {rule.name: rule for rule in self._book.rules}
        for alert in alerts:
            place = (alert.robot, alert.camera, alert.name, alert.object)
            if alert.id in self._alerts:
                continue
            alert = linked(alert, self._page)  # noqa: PLW2901 - its address may be another one by now
            self._alerts[alert.id] = (alert, place)
            rule = rules.get(alert.rule)
            if isinstance(rule, DisagreeRule) and not rule.of:
                self._inherited.setdefault((alert.robot, alert.camera), set()).add(alert.name)
            if alert.id in escalated or had_escalated(alert, rule):
                self._escalated.add(alert.id)
            is_about = rule is not None and model.is_about(rule, *place)
            subject = self._subjects.take(alert.rule, place) if is_about else None
            if subject is None or subject.alert is not None:
                self._change(alert, AlertState.RESOLVED, now_ns)
            else:
                subject.holds, subject.alert, subject.text = True, alert, alert.text
                subject.since_ns = subject.raised_ns = min(alert.raised_ns, now_ns)
                self._waiting.discard(alert.rule, place)

    def changed(self, changes: Iterable[Change], now_ns: int) -> None:
        """Take changes of the inventory: of what came or went. How many are in view is found in `look`."""
        self._advance(now_ns)
        for change in changes:
            key = change.sighting.key
            for rule in self.rules_of(key):
                found = found_in(change, rule) if isinstance(rule, AppearsRule | DisappearsRule) else None
                if found is not None:
                    self._find(rule, (key.robot, key.camera, found.name, ""), found, now_ns)

    def forget(self, cameras: Collection[tuple[str, str]]) -> None:
        """Forget robots' cameras, but for the alerts about them."""
        for camera in cameras:
            self._unknown.discard(camera)
            self._cameras.pop(camera, None)
        for name, place, subject in list(self._subjects):
            if place[:2] in cameras and subject.alert is None:
                self._waiting.discard(name, place)
                self._subjects.drop(name, place)

    def rules_of(self, key: CameraKey) -> list[AnyRule]:
        """Return the rules that are about a camera."""
        place = (key.robot, key.camera)
        found = self._cameras.get(place)
        if found is None:
            found = [rule for rule in self._book.rules if rule.applies_to(*place)]
            if len(self._cameras) < MAX_SUBJECTS:
                self._cameras[place] = found
        return found

    def subject(self, rule: str, place: SubjectKey) -> Subject | None:
        """Return what is known of a rule at a place, to read only."""
        return self._subjects.get(rule, place)

    def end(self, rule: AnyRule, place: SubjectKey, now_ns: int) -> int | None:
        """Take that a condition holds no more; return when it was raised last, None if it did not hold."""
        self._advance(now_ns)
        subject = self.subject(rule.name, place)
        raised_ns = subject.raised_ns if subject is not None and subject.holds else None
        self._find(rule, place, Finding(place[2], holds=False), now_ns)
        return raised_ns

    def note_raised(self, rule: AnyRule, place: SubjectKey, at_ns: int) -> None:
        """Take that a rule with a cooldown was raised, for a condition that holds no more."""
        subject = self._subjects.take(rule.name, place) if rule.cooldown_s > 0 else None
        if subject is not None:
            subject.raised_ns = max(at_ns, subject.raised_ns or 0)

    def concerns(self, key: CameraKey) -> bool:
        """Whether any rule is about a camera."""
        return bool(self.rules_of(key))

    def look(self, look: CameraState, now_ns: int) -> None:
        """Take the current state of one camera."""
        self._advance(now_ns)
        robot, camera = look.key.robot, look.key.camera
        if (names := self._inherited.get((robot, camera))) is not None:  # classes of restored alerts
            look = msgspec.structs.replace(look, counts={**dict.fromkeys(names, 0), **look.counts})
        (self._unknown.discard if look.available else self._unknown.add)((robot, camera))
        for rule in self.rules_of(look.key):
            for found in findings(rule, look):
                self._find(rule, (robot, camera, found.name, ""), found, now_ns)

    def robot(self, robot: str, *, alive: bool | None, now_ns: int) -> None:
        """Take whether a robot's gateway is online, None if unknown; now_ns: now, or when it went offline."""
        rules = self._robots.get(robot)
        if rules is None:
            silent = [rule for rule in self._book.rules if isinstance(rule, SilentRule) and not rule.of_cameras]
            rules = [rule for rule in silent if rule.applies_to(robot, "")]
            if len(self._robots) < MAX_SUBJECTS:
                self._robots[robot] = rules
        for rule in rules:
            found = Finding("", None if alive is None else not alive, alert_texts.offline(robot))
            self._find(rule, (robot, "", "", ""), found, now_ns)

    def world(self, rule: WorldRule, robot: str, found: Finding, now_ns: int) -> None:
        """Take whether the condition of a rule on a site holds; robot: the one it is about, or empty."""
        self._advance(now_ns)
        if rule.applies_to(robot, ""):
            self._find(cast("AnyRule", rule), (robot, "", found.name, found.object), found, now_ns)

    def has_room_again(self) -> bool:
        """Whether there is room again for subjects left out, once: then all must be offered again."""
        return self._subjects.has_room_again()

    def next_ns(self, now_ns: int) -> int | None:
        """Return the next time, after now, at which something may be due; None if nothing is waiting."""
        ripening_ns = self._waiting.next_ns()
        moments = [
            *([] if ripening_ns is None else [ripening_ns]),
            *(model.opening_ns(rule, now_ns) for rule in self._book.rules if rule.name in self._waiting.ripe),
            *(due_ns for _, due_ns in self._escalations()),
        ]
        return min((moment for moment in moments if moment > now_ns), default=None)

    def due(self, now_ns: int) -> list[Effect]:
        """Advance time; return the effects on alerts since the last call."""
        self._advance(now_ns)
        self._raise_due(now_ns)
        self._escalate_due(now_ns)
        self._subjects.make_room_again()
        effects, self._effects = self._effects, []
        return effects

    def _advance(self, now_ns: int) -> None:
        """Let time pass. If the clock was set back, nothing waits for it to be again what it was."""
        by_ns, self._now_ns = self._now_ns - now_ns, now_ns
        if by_ns > 0:
            for _, _, subject in self._subjects:
                subject.since_ns -= by_ns
                subject.raised_ns = None if subject.raised_ns is None else subject.raised_ns - by_ns
                subject.alert = None if subject.alert is None else set_back(subject.alert, now_ns, by_ns)
            self._alerts = {
                name: (set_back(alert, now_ns, by_ns), place) for name, (alert, place) in self._alerts.items()
            }
            self._waiting.set_back(by_ns)

    def _raise_due(self, now_ns: int) -> None:
        self._waiting.ripen(now_ns)
        if not self._waiting.ripe:
            return
        local = local_time(now_ns, self._book.timezone)
        applying = [rule for rule in self._book.rules if rule.name in self._waiting.ripe and rule.applies_at(local)]
        for rule in applying:
            for place in [place for place in self._waiting.ripe[rule.name] if self._is_known(rule, place)]:
                self._raise(rule, place, self._subjects.known(rule.name, place), now_ns)

    def _is_known(self, rule: AnyRule, place: SubjectKey) -> bool:
        """Whether a condition is known to hold now, and not only at its last observation."""
        known = self._subjects.known(rule.name, place).known
        return known and (isinstance(rule, SilentRule) or place[:2] not in self._unknown)

    def _escalate_due(self, now_ns: int) -> None:
        for alert in [alert for alert, due_ns in self._escalations() if due_ns <= now_ns]:
            self._change(alert, AlertState.ESCALATED, now_ns)

    def _escalations(self) -> Iterator[tuple[Alert, int]]:
        """Yield the unacknowledged alerts and when each escalates."""
        after_s = {rule.name: rule.escalate_after_s for rule in self._book.rules if rule.escalate_after_s is not None}
        for alert, place in self._alerts.values() if after_s else ():
            if alert.state is AlertState.RAISED and alert.rule in after_s:
                raised_ns = self._subjects.known(alert.rule, place).raised_ns or 0
                yield alert, raised_ns + round(after_s[alert.rule] * NS)

    def acknowledge(self, alert_id: str, now_ns: int) -> Alert:
        """Acknowledge an alert.

        Raises:
            UnknownAlertError: it is not there any more.
        """
        alert = self._known(alert_id)
        return alert if alert.state is AlertState.ACKNOWLEDGED else self._change(alert, AlertState.ACKNOWLEDGED, now_ns)

    def escalate(self, alert_id: str, now_ns: int) -> Alert:
        """Escalate an alert.

        Raises:
            UnknownAlertError: it is not there any more.
        """
        alert = self._known(alert_id)
        return alert if alert.state is AlertState.ESCALATED else self._change(alert, AlertState.ESCALATED, now_ns)

    def resolve(self, alert_id: str, now_ns: int) -> Alert:
        """Resolve an alert; it is raised again only after its condition has cleared.

        Raises:
            UnknownAlertError: it is not there any more.
        """
        return self._change(self._known(alert_id), AlertState.RESOLVED, now_ns)

    def _known(self, alert_id: str) -> Alert:
        if alert_id not in self._alerts:
            raise UnknownAlertError(f"no open alert {alert_id[:64]!r}")
        return self._alerts[alert_id][0]

    def _find(self, rule: AnyRule, place: SubjectKey, found: Finding, now_ns: int) -> None:
        subject = self._subjects.get(rule.name, place)
        if subject is None:
            if not found.holds:
                return
            subject = self._subjects.take(rule.name, place)
            if subject is None:
                return
        subject.known = found.holds is not None
        if found.holds is None:
            return
        if found.holds and not subject.holds:
            since_ns = now_ns if found.since_ns is None else found.since_ns
            subject.holds = True
            subject.since_ns = min(since_ns, self._now_ns or since_ns)  # the clock may have been set back
            self._waiting.add(rule.name, place, self._due_ns(rule, subject))
        elif not found.holds and subject.holds:
            subject.holds = False
            self._waiting.discard(rule.name, place)
            if subject.alert is not None:
                self._change(subject.alert, AlertState.RESOLVED, now_ns)
            if rule.cooldown_s == 0:
                self._subjects.drop(rule.name, place)
        if found.holds:
            subject.text = found.text

    def _due_ns(self, rule: AnyRule, subject: Subject) -> int:
        held_ns = subject.since_ns + round(rule.for_s * NS)
        if subject.raised_ns is None:
            return held_ns
        return max(held_ns, subject.raised_ns + round(rule.cooldown_s * NS))

    def _raise(self, rule: AnyRule, place: SubjectKey, subject: Subject, now_ns: int) -> None:
        alert = linked(new_alert(self._new_id(), rule, place, subject.text, now_ns), self._page)
        self._waiting.discard(rule.name, place)
        subject.alert, subject.raised_ns = alert, now_ns
        self._alerts[alert.id] = (alert, place)
        self._effects.append(Effect(alert, rule, raised=True))

    def _change(self, alert: Alert, state: AlertState, now_ns: int) -> Alert:
        place = self._alerts[alert.id][1]
        changed = msgspec.structs.replace(alert, state=state, changed_ns=max(now_ns, alert.changed_ns + 1))
        over = state is AlertState.RESOLVED
        subject = self._subjects.get(alert.rule, place)
        if subject is not None and subject.alert is not None and subject.alert.id == alert.id:
            subject.alert = None if over else changed
        if over:
            del self._alerts[alert.id]
        else:
            self._alerts[alert.id] = (changed, place)
        rule = next((rule for rule in self._book.rules if rule.name == alert.rule), None)
        if state is AlertState.ESCALATED:
            self._escalated.add(alert.id)
        self._effects.append(Effect(changed, rule, raised=False, escalated=alert.id in self._escalated))
        if over:
            self._escalated.discard(alert.id)
        return changed
