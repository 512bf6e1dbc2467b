"""Models of the API's responses. Times are UTC; None where there is none yet. Pure."""

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Generic, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from schemas.alerts import AlertState, Severity
from services.monitor.formats import rounded
from services.monitor.web.auth.users import Role

T = TypeVar("T")

Figure = Annotated[float, AfterValidator(rounded)]


class Part(BaseModel):
    """The base of all response models."""

    model_config = ConfigDict(frozen=True, from_attributes=True, populate_by_name=True)


class Page(Part, Generic[T]):
    """One page of items. next: the value of `after` for the following page; None at the end."""

    now: datetime
    items: list[T]
    next: str | None = None


class ErrorAnswer(Part):
    """An error response of any status."""

    error: str


class ClassInView(Part):
    """How many objects of a class are in view, and the best score."""

    name: str
    count: int
    score: float


class RobotAnswer(Part):
    """A robot. age_s: of its newest class list; rate_hz: class lists of all its cameras; dropped: frames by reason."""

    name: str
    online: bool
    last_seen: datetime | None
    cameras: tuple[str, ...]
    age_s: float | None
    rate_hz: float
    waiting_for: str
    problems: tuple[str, ...]
    dropped: Mapping[str, int]


class CameraAnswer(Part):
    """A camera. stale: its view may be outdated. age_exact: whether the age includes the transport delay.

    classes: in view, or were last, settled as in the inventory; None before that is known. served_by: workers that look
    after it, as service/name.
    """

    robot: str
    camera: str
    online: bool
    stale: bool
    last_seen: datetime | None
    age_s: float | None
    age_exact: bool
    rate_hz: float
    classes: tuple[ClassInView, ...] | None
    served_by: tuple[str, ...]
    dropped: Mapping[str, int]


class SightingAnswer(Part):
    """A class that is or was in view of a camera. available: it is current."""

    robot: str
    camera: str
    name: str = Field(serialization_alias="class")
    count: int
    score: float
    first_seen: datetime | None
    last_seen: datetime | None
    nearest_m: float | None
    model: str
    worker: str
    available: bool


class IntervalAnswer(Part):
    """A period in which one class was in view of one camera with a constant count. open: it continues."""

    robot: str
    camera: str
    name: str = Field(serialization_alias="class")
    count: int
    since: datetime
    until: datetime
    open: bool
    score: float
    closest_m: float | None
    first_seen: datetime
    model: str
    worker: str


class ActAnswer(Part):
    """An operator's action on an alert."""

    state: AlertState
    who: str
    at: datetime


class AlertAnswer(Part):
    """An alert with operators' actions on it.

    known_until: when its camera was heard last, if its robot is gone or its camera silent, so that nobody knows whether
    what it says is still so; None while that is known, of alerts about silence itself, and of resolved ones.
    site, object: that it is about, empty where there is none. link: the path of the object's page.
    """

    id: str
    rule: str
    severity: Severity
    state: AlertState
    robot: str
    camera: str
    name: str = Field(serialization_alias="class")
    site: str
    object: str
    link: str
    text: str
    raised: datetime
    changed: datetime
    known_until: datetime | None
    acts: tuple[ActAnswer, ...]


class LoadAnswer(Part):
    """One camera at a worker."""

    robot: str
    camera: str
    serving: bool
    inferred: int
    dropped: Mapping[str, int]
    budget_hz: Figure | None


class WorkerAnswer(Part):
    """A worker. version: of its software; runtime: of its model, such as openvino-int8; empty if unknown."""

    service: str
    worker: str
    model: str
    online: bool
    last_seen: datetime | None
    cameras: tuple[LoadAnswer, ...]
    remarks: tuple[str, ...]
    version: str
    runtime: str


class StreamAnswer(Part):
    """A ROS topic on its way to the bus."""

    name: str
    topic: str
    wanted: bool
    publishers: int
    received: int
    forwarded: int
    received_hz: Figure
    forwarded_hz: Figure
    bytes: int
    compression: str
    missing: int
    dropped: Mapping[str, int]
    broken_links: Mapping[str, int]
    problem: str


class ReturnAnswer(Part):
    """Results on their way to ROS."""

    camera: str
    stream: str
    topic: str
    wanted: bool
    subscribers: int
    received: int
    published: int
    dropped: Mapping[str, int]


class GatewayAnswer(Part):
    """The last status of a robot's gateway. version: of its software, empty if unknown."""

    robot: str
    online: bool
    last_seen: datetime | None
    waiting_for: str
    clock_jumps: int
    streams: tuple[StreamAnswer, ...]
    returns: tuple[ReturnAnswer, ...]
    withdrawn: Mapping[str, int]
    version: str


class RulesAnswer(Part):
    """The rules in force. problem: the mistake in the newest version of the file, with its line, or empty.

    remarks: classes that no detector there reports, and robots that there are none of, by rule.
    """

    file: str | None
    problem: str
    remarks: tuple[str, ...]
    timezone: str | None
    webhooks: tuple[str, ...]
    rules: tuple[dict[str, Any], ...]


class HistoryAnswer(Part):
    """The status of the history. problem: why it is not written, or empty. leads: this monitor raises the alerts."""

    problem: str
    leads: bool
    pending: int
    lost: int


class StatusAnswer(Part):
    """The monitor itself. problems: its own problems. left_out: ignored messages, by reason.

    alerts: that are not resolved, whichever monitor raised them; None while another one does and they cannot be read.
    """

    version: str
    now: datetime
    started: datetime
    problems: tuple[str, ...]
    left_out: Mapping[str, int]
    history: HistoryAnswer
    robots: int
    robots_online: int
    cameras: int
    alerts: int | None


class MeAnswer(Part):
    """The user of the request."""

    name: str
    role: Role
