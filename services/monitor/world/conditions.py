"""Evaluates the rules on the objects of sites. Pure: time is an argument."""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from services.monitor.liveness import POSE_LIVE_NS, is_recent
from services.monitor.map.pose import Pose
from services.monitor.map.sites import Sites
from services.monitor.rules.findings import Finding
from services.monitor.rules.model import (
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

NS: Final = 1_000_000_000
MAX_IDS: Final = 10_000
"""Objects that one rule remembers; of more, those that entered, left or moved first are forgotten."""

FLOOR_FRESH_NS: Final = 30 * NS
LEAST_SHARE: Final = 0.5
"""Share of a zone's floor of which looks count as one at the zone."""

MOST_NAMED: Final = 3

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
        self._raised: set[str] = set()
        self._near: defaultdict[str, set[str]] = defaultdict(set)

    def begin(self) -> None:
        """Begin anew, as when this monitor becomes the one that raises alerts: what happened before does not count."""
        self._rules = {}
        for site in self._world.sites.values():
            site.transitions.clear()

    def evaluate(self, rules: Iterable[WorldRule], now_ns: int) -> Iterator[Found]:
        """Yield the findings of all rules; a condition is unknown while its site or zone is.

        An object of which a rule says that it entered, left or moved counts from when the rule was in force.
        """
        current = {rule.name: rule for rule in rules}
        kept = {name for name, rule in current.items() if self._rules.get(name) == rule}
        self._ids = {name: ids for name, ids in self._ids.items() if name in kept}
        self._rests = {name: rests for name, rests in self._rests.items() if name in kept}
        self._raised &= kept
        self._rules = current
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
        if isinstance(rule, NearRobotRule):
            yield from self._near_robots(rule, objects, now_ns)
        elif objects is None or not _has_zone(rule, objects):
            yield rule, "", Finding(rule.of, holds=None)
        elif isinstance(rule, UnseenRule):
            yield rule, "", _unseen(rule, objects, now_ns)
        else:
            text = self._text(rule, objects, now_ns)
            unsure = (
                isinstance(rule, EntersRule) and rule.name not in self._raised and objects.count(rule.zone)[rule.of]
            )
            if text:
                self._raised.add(rule.name)
            yield rule, "", Finding(rule.of, holds=True if text else None if unsure else False, text=text)

    def _text(self, rule: WorldRule, objects: SiteObjects, now_ns: int) -> str:
        """Return what holds, in words; nothing if it does not."""
        ids: list[str] = []
        match rule:
            case EntersRule():
                entered = self._ids[rule.name]
                for each in [each for each in entered if not _is_in(each, rule, objects)]:
                    del entered[each]
                ids, verb = list(entered), "entered"
            case LeavesRule():
                ids, verb = [each for each in self._recent(rule, now_ns) if not _is_in(each, rule, objects)], "left"
            case MovedRule():
                ids, verb = self._recent(rule, now_ns), "moved in"
            case _:
                return _state_text(rule, objects)
        return f"{rule.of} {_named(ids)} {verb} {_place(rule)}" if ids else ""

    def _recent(self, rule: LeavesRule | MovedRule, now_ns: int) -> list[str]:
        """Return the objects of a rule that are not older than its `within_s`, nor from a later time."""
        ids = self._ids[rule.name]
        old_ns = now_ns - round(rule.within_s * NS)
        for each in [each for each, at_ns in ids.items() if not old_ns < at_ns <= now_ns]:
            del ids[each]
        return list(ids)

    def _near_robots(self, rule: NearRobotRule, objects: SiteObjects | None, now_ns: int) -> Iterator[Found]:
        near, seen = set[str](), set[str]()
        for robot in self._sites.robots(rule.site) if objects is not None else ():
            pose = self._poses.get(robot)
            if objects is None or pose is None or not is_recent(pose.at_ns, now_ns, POSE_LIVE_NS):
                continue
            seen.add(robot)
            found = objects.near(rule.of, pose.x, pose.y, rule.than_m)
            text = ""
            if found is not None:
                near.add(robot)
                text = f"{rule.of} {found[0]} is {found[1]:.2f} m from {robot}, nearer than {rule.than_m:g} m"
            yield rule, robot, Finding(rule.of, holds=found is not None, text=text)
        lost = self._near[rule.name] - seen
        for robot in sorted(lost):
            yield rule, robot, Finding(rule.of, holds=None)
        self._near[rule.name] = near | lost


def _unseen(rule: UnseenRule, objects: SiteObjects, now_ns: int) -> Finding:
    floor = objects.floor.get(rule.zone)
    if floor is None or not is_recent(floor.at_ns, now_ns, FLOOR_FRESH_NS):
        return Finding("", holds=None)
    share = floor.share_seen(rule.than_s, now_ns)
    text = f"{share:.0%} of {_place(rule)} was looked at during the last {rule.than_s:g} s"
    return Finding("", holds=share < LEAST_SHARE, text=text)


def _state_text(rule: WorldRule, objects: SiteObjects) -> str:
    """Return what holds of a rule that looks at the present alone."""
    match rule:
        case ZoneOverRule() | ZoneUnderRule():
            count = objects.count(rule.zone).get(rule.of, 0)
            over = isinstance(rule, ZoneOverRule)
            holds = count > rule.count if over else count < rule.count
            return f"{count} {rule.of} in {_place(rule)}, {'over' if over else 'under'} {rule.count}" if holds else ""
        case MissingRule() if not _is_in(rule.object, rule, objects):
            placed = objects.objects.get(rule.object)
            where = "gone" if placed is None else f"at {placed.x:.1f}, {placed.y:.1f} m"
            return f"{rule.of} {rule.object} is missing from {_place(rule)}: it is {where}"
    return ""


def _is_in(object_id: str, rule: ZoneRule, objects: SiteObjects) -> bool:
    placed = objects.objects.get(object_id)
    return placed is not None and rule.zone in placed.zones


def _limit(by_id: dict[str, Any]) -> None:
    while len(by_id) > MAX_IDS:
        del by_id[next(iter(by_id))]


def _has_zone(rule: WorldRule, objects: SiteObjects) -> bool:
    zone = getattr(rule, "zone", "")
    return not zone or any(each.name == zone for each in objects.zones)


def _place(rule: ZoneRule | MovedRule) -> str:
    return f"{rule.site}/{rule.zone}" if rule.zone else rule.site


def _named(ids: list[str]) -> str:
    more = len(ids) - MOST_NAMED
    return ", ".join(ids[-MOST_NAMED:]) + (f" and {more} more" if more > 0 else "")


def remarks_on_zones(rules: Iterable[WorldRule], world: World) -> Iterator[str]:
    """Yield a line for each rule on a site that no world model has told of, or on a zone that the zone file has not."""
    for rule in rules:
        objects = world.sites.get(rule.site)
        if objects is None:
            why = "no world model has told of it" if world.on else "set --world on"
            yield f"rule {rule.name!r}: site {rule.site} is not followed: {why}"
        elif not _has_zone(rule, objects):
            yield f"rule {rule.name!r}: site {rule.site} has no zone {getattr(rule, 'zone', '')!r}"
