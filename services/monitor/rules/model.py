"""The data model of a rule file. Pure."""

from datetime import datetime, time
from fnmatch import fnmatchcase
from typing import Annotated, Any, Final, Literal, Self, get_args
from zoneinfo import ZoneInfo

from pydantic import BaseModel, ConfigDict, Field, HttpUrl, NonNegativeInt, field_validator, model_validator
from pydantic_core import PydanticCustomError

from schemas.alerts import MAX_PAYLOAD, Severity
from schemas.header import MAX_LABEL
from schemas.keys import NAME

MAX_RULES: Final = 500
Day = Literal["mon", "tue", "wed", "thu", "fri", "sat", "sun"]
QUARTER_NS: Final = 900 * 1_000_000_000
DAYS: Final[tuple[Day, ...]] = get_args(Day)

PLACEHOLDERS: Final = ("{robot}", "{camera}", "{class}")
"""Placeholders in an action's payload."""

Text = Annotated[str, Field(min_length=1, max_length=MAX_LABEL)]
Patterns = Annotated[tuple[Annotated[str, Field(min_length=1, max_length=64)], ...], Field(max_length=1_000)]
Seconds = Annotated[float, Field(ge=0, le=86_400 * 30)]
WebhookNames = Annotated[tuple[str, ...], Field(max_length=16)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class RobotAction(_Part):
    """The action a robot performs when an alert about it is raised, if its gateway's settings allow it.

    payload: `{robot}`, `{camera}` and `{class}` in it become the alert's.
    """

    name: Annotated[str, Field(pattern=f"^{NAME.pattern}$")]
    payload: Annotated[str, Field(max_length=MAX_PAYLOAD // 2)] = ""


class Rule(_Part):
    """The fields of every rule. robots, cameras: names, or patterns such as `r*`; all unless given.

    for_s: how long it must be so without a gap. between: local times of day, over midnight too. days: on which those
    begin. cooldown_s: after an alert was raised, none of the same rule, robot, camera and class for so long.
    escalate_after_s: an alert that nobody acknowledged by then escalates. webhooks: hear of all that becomes of an
    alert; escalate_webhooks: from its escalation on.
    """

    name: Text
    robots: Patterns = ("*",)
    cameras: Patterns = ("*",)
    between: tuple[time, time] | None = None
    days: Annotated[tuple[Day, ...], Field(min_length=1)] = DAYS
    severity: Severity = Severity.WARNING
    for_s: Seconds = 0.0
    cooldown_s: Seconds = 0.0
    escalate_after_s: Annotated[float, Field(gt=0, le=86_400 * 30)] | None = None
    webhooks: WebhookNames = ()
    escalate_webhooks: WebhookNames = ()
    action: RobotAction | None = None

    @field_validator("between", mode="before")
    @classmethod
    def _written_with_a_colon(cls, value: Any) -> Any:
        """YAML reads 22:30 without quotes as a number of minutes, and 22.30 as one of seconds."""
        if isinstance(value, list) and any(isinstance(each, int | float) for each in value):
            raise ValueError("write times in quotes, like ['22:00', '06:00']")
        return value

    @field_validator("between")
    @classmethod
    def _is_a_part_of_the_day(cls, value: tuple[time, time] | None) -> tuple[time, time] | None:
        if value is not None and any(each.tzinfo for each in value):
            raise ValueError("write times without a time zone; `timezone` at the top of the file sets it")
        if value is not None and value[0] == value[1]:
            raise ValueError("starts and ends at the same time; leave it out for the whole day")
        return value

    def applies_to(self, robot: str, camera: str) -> bool:
        """Whether the rule covers a robot's camera, or the whole robot if the camera is empty."""
        cameras = ("*",) if not camera else self.cameras
        return _matches(robot, self.robots) and _matches(camera, cameras)

    def applies_at(self, local: datetime) -> bool:
        """Whether the rule applies at a time. Periods over midnight belong to the day on which they begin."""
        now, day = local.time().replace(tzinfo=None), local.weekday()
        if self.between is not None:
            begin, end = self.between
            over_midnight = begin > end
            if over_midnight and now < end:
                day -= 1
            elif now < begin or not (over_midnight or now < end):
                return False
        return DAYS[day] in self.days


class ClassRule(Rule):
    """A rule about one class of objects."""

    of: Annotated[Text, Field(alias="class")]


class AppearsRule(ClassRule):
    """A class comes into view; objects in view when the monitor or camera started do not count."""

    when: Literal["appears"]


class DisappearsRule(ClassRule):
    """A class goes out of view."""

    when: Literal["disappears"]


class OverRule(ClassRule):
    """More objects than `count` are in view."""

    when: Literal["over"]
    count: NonNegativeInt


class UnderRule(ClassRule):
    """Fewer objects than `count` are in view."""

    when: Literal["under"]
    count: Annotated[int, Field(ge=1)]


class NearerRule(ClassRule):
    """An object is nearer than `than_m` metres."""

    when: Literal["nearer"]
    than_m: Annotated[float, Field(gt=0, le=1_000)]


class SilentRule(Rule):
    """A robot's gateway is gone or, with `cameras`, one of these cameras sends no class lists."""

    when: Literal["silent"]

    @property
    def of_cameras(self) -> bool:
        """Whether the rule covers cameras."""
        return "cameras" in self.model_fields_set


class DisagreeRule(Rule):
    """Two models on the same camera count differently; of one class if that is given."""

    when: Literal["disagree"]
    of: Annotated[str, Field(alias="class", max_length=MAX_LABEL)] = ""


class WorldRule(ClassRule):
    """A rule about the objects of a site, each of which counts once, whoever saw it."""

    site: Annotated[str, Field(pattern=f"^{NAME.pattern}$")] = "main"

    @model_validator(mode="after")
    def _is_about_no_camera(self) -> Self:
        for field in ("cameras",) if isinstance(self, NearRobotRule) else ("cameras", "robots"):
            if field in self.model_fields_set:
                raise ValueError(f"a rule with `when: {self.when}` takes no `{field}`; leave it out")  # type: ignore[attr-defined]
        if self.action is not None and not isinstance(self, NearRobotRule):
            raise ValueError("an action needs a robot, and this rule is about none; use `webhooks`")
        return self

    def applies_to(self, robot: str, camera: str) -> bool:
        """Whether the rule covers a robot, or the site as a whole if the name is empty; never a camera."""
        return not camera and (not robot or (isinstance(self, NearRobotRule) and _matches(robot, self.robots)))


class ZoneRule(WorldRule):
    """A rule about the objects in one zone."""

    zone: Text


class ZoneOverRule(ZoneRule):
    """More objects than `count` are in the zone."""

    when: Literal["zone_over"]
    count: NonNegativeInt


class ZoneUnderRule(ZoneRule):
    """Fewer objects than `count` are in the zone."""

    when: Literal["zone_under"]
    count: Annotated[int, Field(ge=1)]


class EntersRule(ZoneRule):
    """An object came into the zone and is still in it."""

    when: Literal["enters"]


class LeavesRule(ZoneRule):
    """An object left the zone, or is gone from it, less than `within_s` ago, and is not back."""

    when: Literal["leaves"]
    within_s: Annotated[float, Field(gt=0, le=86_400)] = 60.0


class MovedRule(WorldRule):
    """An object was moved by `than_m` or more, less than `within_s` ago; of one zone if that is given."""

    when: Literal["moved"]
    zone: Annotated[str, Field(max_length=MAX_LABEL)] = ""
    than_m: Annotated[float, Field(gt=0, le=1_000)] = 0.5
    within_s: Annotated[float, Field(gt=0, le=86_400)] = 60.0


class MissingRule(ZoneRule):
    """One object, by its id, is not in the zone."""

    when: Literal["missing"]
    object: Annotated[str, Field(min_length=1, max_length=64)]


class NearRobotRule(WorldRule):
    """An object is nearer than `than_m` metres to a robot, as their places in the map say."""

    when: Literal["near_robot"]
    than_m: Annotated[float, Field(gt=0, le=20)]


class UnseenRule(ZoneRule):
    """Less than half of the zone's floor was looked at during the last `than_s`. It is about no class."""

    when: Literal["unseen"]
    of: Annotated[Literal[""], Field(alias="class")] = ""
    than_s: Annotated[float, Field(ge=30, le=60_000)]


OF_OBJECTS: Final = (EntersRule, LeavesRule, MovedRule, MissingRule, NearRobotRule)
"""Rules that raise an alert for each object that they hold for."""

AnyRule = Annotated[
    AppearsRule
    | DisappearsRule
    | OverRule
    | UnderRule
    | NearerRule
    | SilentRule
    | DisagreeRule
    | ZoneOverRule
    | ZoneUnderRule
    | EntersRule
    | LeavesRule
    | MovedRule
    | MissingRule
    | NearRobotRule
    | UnseenRule,
    Field(discriminator="when"),
]


class Webhook(_Part):
    """A URL to which alerts are posted as JSON. secret: their signing key (HMAC-SHA256)."""

    url: HttpUrl
    secret: Annotated[str, Field(min_length=8, max_length=512)]


class RuleBook(_Part):
    """A whole rule file. timezone: zone of the times of day, such as Europe/Berlin; default: this machine's."""

    rules: Annotated[tuple[AnyRule, ...], Field(max_length=MAX_RULES)] = ()
    webhooks: Annotated[dict[str, Webhook], Field(max_length=100)] = {}
    timezone: str | None = None

    @field_validator("timezone")
    @classmethod
    def _is_known(cls, value: str | None) -> str | None:
        try:
            return value if value is None else ZoneInfo(value).key
        except (ValueError, OSError, KeyError) as error:
            raise ValueError(f"no time zone {value[:80] if value else ''!r}") from error

    @model_validator(mode="after")
    def _names_what_there_is(self) -> Self:
        names = [rule.name for rule in self.rules]
        for place, rule in enumerate(self.rules):
            if rule.name in names[:place]:
                raise _mistake(place, "name", f"two rules are called {rule.name!r}")
            for field, names_given in (("webhooks", rule.webhooks), ("escalate_webhooks", rule.escalate_webhooks)):
                unknown = next((each for each in names_given if each not in self.webhooks), None)
                if unknown is not None:
                    reason = f"rule {rule.name!r} names an unknown webhook {unknown!r}; add it to `webhooks`"
                    raise _mistake(place, field, reason)
        return self


def is_about(rule: AnyRule, robot: str, camera: str, name: str, object_id: str = "") -> bool:
    """Whether a rule raises alerts about a robot, camera, class and object; each may be empty."""
    if bool(object_id) is not isinstance(rule, OF_OBJECTS):
        return False
    match rule:
        case SilentRule():
            fits = bool(camera) is rule.of_cameras and not name
        case WorldRule():
            fits = bool(robot) is isinstance(rule, NearRobotRule) and rule.of == name
        case DisagreeRule():
            fits = bool(camera) and rule.of in ("", name)
        case _:
            fits = bool(camera) and rule.of == name
    return fits and rule.applies_to(robot, camera)


def opening_ns(rule: AnyRule, now_ns: int) -> int:
    """Return the next moment, epoch nanoseconds, at which a rule that does not apply now may start to.

    Clocks are turned, and differ from UTC by, whole quarters of an hour.
    """
    begin = time() if rule.between is None else rule.between[0]
    into_ns = (begin.minute * 60 + begin.second) * 1_000_000_000 + begin.microsecond * 1_000
    return min(now_ns + QUARTER_NS - (now_ns - phase_ns) % QUARTER_NS for phase_ns in (0, into_ns))


def same_rule(rule: AnyRule, other: AnyRule | None) -> bool:
    """Whether two rules have the same meaning; for `silent`, `cameras` must be given in both or neither."""
    given = other is not None and "cameras" in other.model_fields_set
    return rule == other and ("cameras" in rule.model_fields_set) == given


def _mistake(rule: int, field: str, reason: str) -> PydanticCustomError:
    """Return an error of the whole file whose context names the rule's field."""
    return PydanticCustomError("across_rules", "{reason}", {"reason": reason, "place": ("rules", rule, field)})


def _matches(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)
