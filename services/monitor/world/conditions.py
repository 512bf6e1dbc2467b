"""Evaluates the rules on the objects of sites. Pure: time is an argument."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, Final

from schemas.alerts import Alert
from services.geometry.boxes import is_itself
from services.monitor.liveness import POSE_LIVE_NS, is_recent
from services.monitor.map.pose import Pose
from services.monitor.rules import alert_texts
from services.monitor.rules.findings import Finding
from services.monitor.rules.model import (
    OF_OBJECTS,
    EntersRule,
    LeavesRule,
    MissingRule,
    MovedRule,
    NearRobotRule,
    UnseenRule,
    WorldRule,
    ZoneOverRule,
    ZoneRule,
    ZoneUnderRule,
)
from services.monitor.world.site_objects import SiteObjects, Transition, World
from services.monitor.world.site_status import Sites

NS: Final = 1_000_000_000
MAX_IDS: Final = 10_000
"""Objects that one rule remembers; of more, those that entered, left or moved first are forgotten."""

NOTHING_HELD: Final[Mapping[str, set[str]]] = {}

FLOOR_FRESH_NS: Final = 30 * NS
LEAST_SHARE: Final = 0.5
"""Share of a zone's floor of which looks count as one at the zone."""

ITSELF_M: Final = 0.3
"""How far outside the box of what others see a robot's place may be for that to be the robot."""

MOST_ALERTS: Final = 100
"""Objects for which a rule has an alert at a time, of `near_robot` at each robot; of more, those that had none wait."""

Found = tuple[WorldRule, str, Finding]
"""A rule, the robot that its finding is about, or an empty name, and the finding."""


class WorldConditions:
    """Says which rules on sites hold, from the objects of these; to be asked about once a second or so."""

    def __init__(self, world: World, sites: Sites, poses: Mapping[str, Pose]) -> None:
        self._world = world
        self._sites = sites
        self._poses = poses
        self._ids: dict[str, dict[str, int]] = {}
        self._rules: dict[str, WorldRule] = {}
        self._rests: dict[str, dict[str, tuple[float, float]]] = {}
        self._held: dict[str, defaultdict[str, set[str]]] = {}
        self._left_out: dict[tuple[str, str], int] = {}

    def begin(self) -> None:
        """Begin anew, as when this monitor becomes the one that raises alerts: earlier events do not count."""
        self._rules = {}
        for site in self._world.sites.values():
            site.transitions.clear()

    def adopt(self, alerts: Iterable[Alert]) -> None:
        """Take the unresolved alerts of an earlier monitor: each holds, or ends, for the object that it is about."""
        for alert in alerts:
            if alert.object:
                self._held.setdefault(alert.rule, defaultdict(set))[alert.robot].add(alert.object)

    def problems(self) -> Iterator[str]:
        """Yield a line for each rule that holds for more objects than it has alerts for."""
        for (rule, robot), count in sorted(self._left_out.items()):
            at = f" at {robot}" if robot else ""
            yield f"rule {rule!r} holds for {count + MOST_ALERTS:,} objects{at}; {MOST_ALERTS} of them have alerts"

    def evaluate(self, rules: Iterable[WorldRule], now_ns: int) -> Iterator[Found]:
        """Yield the findings of all rules; a condition is unknown while its site or zone is.

        An object of which a rule says that it entered, left or moved counts from when the rule was in force.
        """
        current = {rule.name: rule for rule in rules}
        kept = {name for name, rule in current.items() if self._rules.get(name) == rule}
        self._ids = {name: ids for name, ids in self._ids.items() if name in kept}
        self._rests = {name: rests for name, rests in self._rests.items() if name in kept}
        self._rules = current
        self._held = {name: held for name, held in self._held.items() if name in current}
        self._left_out = {at: count for at, count in self._left_out.items() if at[0] in current}
        by_site: defaultdict[str, list[WorldRule]] = defaultdict(list)
        for rule in current.values():
            by_site[rule.site].append(rule)
        for name, site in self._world.sites.items():
            site.floor_wanted = frozenset(rule.zone for rule in by_site[name] if isinstance(rule, UnseenRule))
            of_class: defaultdict[str, list[Transition]] = defaultdict(list)
            for each in site.transitions:
                of_class[each.name].append(each)
            site.transitions.clear()
            for rule in by_site[name]:
                if isinstance(rule, EntersRule | LeavesRule | MovedRule):
                    self._note(rule, of_class[rule.of], now_ns)
        for name, some in by_site.items():
            objects = self._world.sites.get(name)
            known = objects is not None and not objects.is_behind and self._sites.is_current(name, now_ns)
            for rule in some:
                yield from self._findings(rule, objects if known else None, now_ns)

    def _note(self, rule: EntersRule | LeavesRule | MovedRule, transitions: Iterable[Transition], now_ns: int) -> None:
        """Remember the objects of which a rule says that they entered, left or moved."""
        ids = self._ids.setdefault(rule.name, {})
        for each in transitions:
            match rule:
                case EntersRule():
                    if each.is_in(rule.zone) and not each.was_in(rule.zone):
                        ids[each.object_id] = now_ns
                case LeavesRule():
                    if each.was_in(rule.zone) and not each.is_in(rule.zone):
                        ids[each.object_id] = now_ns
                case MovedRule():
                    if self._has_moved(rule, each):
                        ids.pop(each.object_id, None)
                        ids[each.object_id] = now_ns
        _limit(ids)

    def _has_moved(self, rule: MovedRule, of: Transition) -> bool:
        """Whether an object is so far from where it was when it had moved last, be it in many small steps."""
        rests = self._rests.setdefault(rule.name, {})
        if of.before is None or of.now is None:
            rests.pop(of.object_id, None)
            return False
        x, y = rests.setdefault(of.object_id, (of.before.x, of.before.y))
        _limit(rests)
        if math.hypot(of.now.x - x, of.now.y - y) < rule.than_m:
            return False
        rests[of.object_id] = of.now.x, of.now.y
        return not rule.zone or of.was_in(rule.zone) or of.is_in(rule.zone)

    def _findings(self, rule: WorldRule, objects: SiteObjects | None, now_ns: int) -> Iterator[Found]:
        if objects is None or not _has_zone(rule, objects):
            yield from self._unknown(rule, set())
        elif isinstance(rule, NearRobotRule):
            yield from self._near_robots(rule, objects, now_ns)
        elif isinstance(rule, UnseenRule):
            yield rule, "", _unseen(rule, objects, now_ns)
        elif isinstance(rule, ZoneOverRule | ZoneUnderRule):
            text = _count_text(rule, objects)
            yield rule, "", Finding(rule.of, holds=bool(text), text=text)
        else:
            yield from self._of_objects(rule, "", self._texts(rule, objects, now_ns))

    def _unknown(self, rule: WorldRule, known: Collection[str]) -> Iterator[Found]:
        """Yield that it is not known whether a rule holds, but for some robots."""
        if not isinstance(rule, OF_OBJECTS):
            yield rule, "", Finding(rule.of, holds=None)
        for robot, held in list(self._held.get(rule.name, NOTHING_HELD).items()):  # more may be adopted meanwhile
            if robot not in known:
                self._left_out.pop((rule.name, robot), None)
                yield from ((rule, robot, Finding(rule.of, holds=None, object=each)) for each in tuple(held))

    def _of_objects(self, rule: WorldRule, robot: str, texts: Mapping[str, str]) -> Iterator[Found]:
        """Yield for which objects a rule holds, and for which not any more. texts: of those it holds for, by id."""
        held = self._held.setdefault(rule.name, defaultdict(set))
        chosen = [each for each in texts if each in held[robot]]
        chosen += list(islice((each for each in texts if each not in held[robot]), max(0, MOST_ALERTS - len(chosen))))
        left_out = len(texts) - len(chosen)
        if left_out:
            self._left_out[rule.name, robot] = left_out
        else:
            self._left_out.pop((rule.name, robot), None)
        over, held[robot] = held[robot].difference(chosen), set(chosen)
        if not chosen:
            del held[robot]
        yield from ((rule, robot, Finding(rule.of, holds=False, object=each)) for each in over)
        yield from ((rule, robot, Finding(rule.of, holds=True, text=texts[each], object=each)) for each in chosen)

    def _texts(self, rule: WorldRule, objects: SiteObjects, now_ns: int) -> dict[str, str]:
        """Return the objects for which a rule holds, by id, the latest first, and that in words."""
        match rule:
            case EntersRule():
                entered = self._ids[rule.name]
                for each in self._held.get(rule.name, NOTHING_HELD).get("", ()):  # it entered before a restart
                    entered.setdefault(each, now_ns)
                for each in [each for each in entered if not _is_in(each, rule, objects)]:
                    del entered[each]
                ids, verb = list(entered), "entered"
            case LeavesRule():
                recent = self._recent(rule, now_ns)
                ids, verb = [each for each in recent if not _is_in(each, rule, objects, merged=True)], "left"
            case MovedRule():
                ids, verb = self._recent(rule, now_ns), "moved in"
            case MissingRule() if not _is_in(rule.object, rule, objects, merged=True):
                placed = objects.known_as(rule.object)
                now_at = None if placed is None else (placed.x, placed.y)
                return {rule.object: alert_texts.missing(rule.of, rule.object, _place(rule), now_at)}
            case _:
                return {}
        return {each: alert_texts.passed(rule.of, each, _place(rule), verb) for each in reversed(ids)}

    def _recent(self, rule: LeavesRule | MovedRule, now_ns: int) -> list[str]:
        """Return the objects of a rule that are not older than its `within_s`, nor from a later time."""
        ids = self._ids[rule.name]
        old_ns = now_ns - round(rule.within_s * NS)
        for each in [each for each, at_ns in ids.items() if not old_ns < at_ns <= now_ns]:
            del ids[each]
        return list(ids)

    def _near_robots(self, rule: NearRobotRule, objects: SiteObjects, now_ns: int) -> Iterator[Found]:
        seen = set[str]()
        for robot in self._sites.robots(rule.site):
            pose = self._poses.get(robot)
            if pose is None or not is_recent(pose.at_ns, now_ns, POSE_LIVE_NS):
                continue
            seen.add(robot)
            around = objects.near(rule.of, pose.x, pose.y, rule.than_m)
            near = [
                each for each in around if not is_itself(objects.objects[each[1]].of, robot, (pose.x, pose.y), ITSELF_M)
            ]
            texts = {
                each: alert_texts.near_robot(rule.of, each, robot, distance_m, rule.than_m) for distance_m, each in near
            }
            yield from self._of_objects(rule, robot, texts)
        yield from self._unknown(rule, seen)


def _unseen(rule: UnseenRule, objects: SiteObjects, now_ns: int) -> Finding:
    floor = objects.floor.get(rule.zone)
    if floor is None or not is_recent(floor.at_ns, now_ns, FLOOR_FRESH_NS):
        return Finding("", holds=None)
    share = floor.share_seen(rule.than_s, now_ns)
    text = alert_texts.unseen(_place(rule), share, rule.than_s)
    return Finding("", holds=share < LEAST_SHARE, text=text)


def _count_text(rule: ZoneOverRule | ZoneUnderRule, objects: SiteObjects) -> str:
    """Return how many objects are in a zone, in words; nothing if the rule does not hold."""
    count = objects.count(rule.zone).get(rule.of, 0)
    over = isinstance(rule, ZoneOverRule)
    holds = count > rule.count if over else count < rule.count
    return alert_texts.count_in_place(rule.of, _place(rule), count, rule.count, over=over) if holds else ""


def _is_in(object_id: str, rule: ZoneRule, objects: SiteObjects, *, merged: bool = False) -> bool:
    """Whether an object is in a rule's zone. merged: it may be so as the one that it was merged into."""
    placed = objects.known_as(object_id) if merged else objects.objects.get(object_id)
    return placed is not None and rule.zone in placed.zones


def _limit(by_id: dict[str, Any]) -> None:
    while len(by_id) > MAX_IDS:
        del by_id[next(iter(by_id))]


def _has_zone(rule: WorldRule, objects: SiteObjects) -> bool:
    zone = getattr(rule, "zone", "")
    return not zone or any(each.name == zone for each in objects.zones)


def _place(rule: WorldRule) -> str:
    return alert_texts.place(rule.site, getattr(rule, "zone", ""))


def remarks_on_zones(rules: Iterable[WorldRule], world: World) -> Iterator[str]:
    """Yield a line for each rule on a site that no world model has told of, or on a zone that the zone file has not."""
    for rule in rules:
        objects = world.sites.get(rule.site)
        if objects is None:
            why = "no world model has told of it" if world.on else "set --world on"
            yield f"rule {rule.name!r}: site {rule.site} is not followed: {why}"
        elif not _has_zone(rule, objects):
            yield f"rule {rule.name!r}: site {rule.site} has no zone {getattr(rule, 'zone', '')!r}"
