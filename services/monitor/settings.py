"""Settings of the monitor, of `fleetsight users` and of `fleetsight rules test`."""

import os
import re
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, HttpUrl, ValidationInfo, field_validator, model_validator

from bus.session.links import host_of, is_unspecified
from bus.settings import BusSettings, Endpoint, port_of
from schemas.errors import SchemaError
from schemas.keys import check_name
from services.monitor.history.settings import HistorySettings, HistoryUrl, Moment, default_url
from services.monitor.inventory.debounce import Debounce
from services.monitor.inventory.inventory import TrustLimits
from services.monitor.inventory.sighting import NS
from services.monitor.liveness import LOST_S, STALE_S
from services.monitor.web.auth.users import Role
from services.option_names import given_as_options

Lists = Annotated[int, Field(ge=1, le=100)]
Seconds = Annotated[float, Field(ge=0, le=3600)]


class InventorySettings(BaseModel):
    """Settings of the inventory: debouncing and time limits."""

    heading: ClassVar = "when objects count as seen"

    appear_lists: Annotated[
        Lists, Field(description="consecutive lists that must show more of a class before its count rises")
    ] = 2
    appear_s: Annotated[Seconds, Field(description="seconds for which they must do so")] = 0.0
    vanish_lists: Annotated[
        Lists, Field(description="consecutive lists that must show less before its count falls")
    ] = 2
    vanish_s: Annotated[Seconds, Field(description="seconds for which they must do so")] = 1.0
    stale_s: Annotated[float, Field(gt=0, le=3600, description="seconds without a list before a camera is stale")] = (
        STALE_S
    )
    lost_s: Annotated[
        float, Field(gt=0, le=86400, description="seconds without a list before a camera's view is unknown")
    ] = LOST_S

    @model_validator(mode="after")
    def _stale_before_lost(self) -> Self:
        if self.stale_s > self.lost_s:
            raise ValueError(f"stale_s {self.stale_s:g} is more than lost_s {self.lost_s:g}; set it to at most lost_s")
        return self

    def limits(self) -> TrustLimits:
        """Return the limits in the inventory's form."""
        debounce = Debounce(self.appear_lists, _ns(self.appear_s), self.vanish_lists, _ns(self.vanish_s))
        return TrustLimits(debounce, stale_ns=_ns(self.stale_s), lost_ns=_ns(self.lost_s))


def _ns(seconds: float) -> int:
    return round(seconds * NS)


def _regular(path: Path) -> Path:
    """Refuse an existing path that is not a regular file; a missing one is reported on reading."""
    if os.path.exists(path) and not os.path.isfile(path):  # noqa: PTH110, PTH113 - these raise nothing
        raise ValueError("not a regular file")
    return path


def _host_name(text: str) -> str:
    name = text.lower().removesuffix(".")
    if not re.fullmatch(r"[a-z0-9_](?:[a-z0-9_.-]{0,251}[a-z0-9_])?", name):
        raise ValueError(f"{text[:80]!r} is no host name; give one without scheme, port and path, like fleet.lan")
    return name


HostName = Annotated[str, AfterValidator(_host_name)]

RegularFile = Annotated[Path, AfterValidator(_regular)]


class AlertingSettings(BaseModel):
    """Settings of alerting."""

    heading: ClassVar = "alerts"

    rules: RegularFile | None = Field(default=None, description="YAML file of rules; read again whenever it changes")


class WebSettings(BaseModel):
    """Settings of the page and the HTTP API."""

    heading: ClassVar = "page and HTTP API"

    web: bool = Field(default=True, description="serve the page and the HTTP API")
    web_host: str = Field(
        default="127.0.0.1",
        min_length=1,
        description="address to listen on; 0.0.0.0 means all addresses of this machine",
    )
    web_port: int = Field(default=8080, ge=0, le=65535, description="port to listen on; 0 picks a free one")
    web_url: HttpUrl | None = Field(
        default=None, description="address that browsers use if a proxy is in front, like https://fleet.example"
    )
    web_host_names: Annotated[
        list[HostName],
        Field(
            description="further host names under which people open the page, like fleet.lan; known are localhost, this"
            " machine's name, that of web_url, and addresses"
        ),
    ] = []
    web_certificate: RegularFile | None = Field(
        default=None, description="certificate with which the page is served over HTTPS; taken anew when it changes"
    )
    web_key: RegularFile | None = Field(default=None, description="the private key of that certificate")
    floor_plan: RegularFile | None = Field(
        default=None, description="floor plan to draw the map on: YAML file of a map in the format of ROS's map_server"
    )
    web_session_hours: float = Field(
        default=168, gt=0, le=8_760, description="hours of inactivity after which a user is logged out"
    )
    web_connections: int = Field(
        default=1_000,
        ge=10,
        le=100_000,
        description="maximum number of simultaneous connections; a quarter of them for one user, and for one address"
        " but that of a proxy on this machine",
    )
    web_open_metrics: bool = Field(default=False, description="let anyone read /metrics without a token")

    @field_validator("web_url")
    @classmethod
    def _is_a_whole_host(cls, url: HttpUrl | None) -> HttpUrl | None:
        if url is not None and (url.path not in (None, "/") or url.query is not None or url.fragment is not None):
            raise ValueError("the page must be at the root of its host; remove the path, as in https://fleet.example")
        return url

    @model_validator(mode="after")
    def _has_certificate_and_key(self) -> Self:
        if (self.web_certificate is None) != (self.web_key is None):
            missing = "web_certificate" if self.web_certificate is None else "web_key"
            raise ValueError(f"{missing}: HTTPS needs a certificate and its key, and one is given; give both")
        if self.web_certificate is not None and self.web_url is not None and self.web_url.scheme != "https":
            raise ValueError("web_url: with web_certificate the page is served over HTTPS; begin it with https://")
        return self


class FollowedWorldSettings(BaseModel):
    """Settings of what the monitor takes of the world models."""

    heading: ClassVar = "world models"

    world: Literal["on", "off"] = Field(
        default="on",
        description="follow the sites of the world models; off: nothing of theirs is subscribed, and the page shows"
        " what cameras have in view alone",
    )
    zones: RegularFile | None = Field(
        default=None, description="YAML file of zones, areas of a site's map in which objects are counted"
    )

    @property
    def follows_world(self) -> bool:
        """Whether the sites of world models are followed."""
        return self.world == "on"

    @model_validator(mode="after")
    def _zones_need_the_world(self) -> Self:
        if self.zones is not None and not self.follows_world:
            raise ValueError("zones count the objects of world models: leave out --zones, or set --world on")
        return self


class CentreSettings(BaseModel):
    """Settings of a warehouse's monitor that reports to a centre, a monitor above several warehouses."""

    heading: ClassVar = "several warehouses"

    centre: list[Endpoint] = Field(
        default=[],
        max_length=16,
        description="Zenoh endpoints of the centre, a monitor above several warehouses: it is told this one's totals,"
        " alerts and objects, and nothing else; the first that answers is used",
    )
    warehouse: str = Field(default="", description="name of this warehouse at the centre")
    centre_tls: Path | None = Field(
        default=None,
        description="certificate for the centre: pki/berlin means pki/ca.pem, pki/berlin.pem and pki/berlin.key; by"
        " default that of --tls",
    )

    @field_validator("warehouse")
    @classmethod
    def _can_be_part_of_a_key(cls, name: str) -> str:
        try:
            if name:
                check_name("warehouse", name)
        except SchemaError as error:
            raise ValueError(str(error)) from error
        return name

    @model_validator(mode="after")
    def _is_known_by_a_name_there(self) -> Self:
        if bool(self.centre) != bool(self.warehouse):
            missing = "warehouse" if self.centre else "centre"
            raise ValueError(f"{missing}: --centre and --warehouse go together; give both")
        return self


class RegistrySettings(BaseModel):
    """Settings of the model registry."""

    heading: ClassVar = "model registry"

    models: Path | None = Field(
        default=None,
        description="folder of published models, from which detectors with --model fleet take theirs; of one monitor"
        " of the fleet alone",
    )


class MonitorSettings(
    WebSettings,
    AlertingSettings,
    RegistrySettings,
    FollowedWorldSettings,
    CentreSettings,
    InventorySettings,
    HistorySettings,
    BusSettings,
):
    """Show the objects seen by every robot of the fleet. It includes the fleet's Zenoh router by default."""

    mode: Annotated[
        Literal["router", "peer", "client"],
        Field(description="part in the Zenoh network: 'router' takes connections itself, 'client' needs a router"),
    ] = "router"
    connect: Annotated[list[Endpoint], Field(description="Zenoh endpoints to connect to")] = []
    listen: Annotated[
        list[Endpoint], Field(description="Zenoh endpoints to listen on (tls/0.0.0.0:7447 for other machines)")
    ] = ["tcp/127.0.0.1:7447"]
    advertise: Annotated[
        Endpoint | None,
        Field(description="endpoint to show to others for connecting, if not an address of this machine"),
    ] = None
    refresh_s: Annotated[float, Field(ge=0.1, le=60, description="seconds between updates of the table")] = 0.5

    def centre_bus(self) -> BusSettings:
        """Return the settings of the session with the centre: as a client, with this monitor's own certificate."""
        own = {"tls_ca": self.tls_ca, "tls_certificate": self.tls_certificate, "tls_key": self.tls_key}
        given = {"tls": self.centre_tls} if self.centre_tls is not None else own
        return BusSettings.model_validate(
            {"mode": "client", "connect": self.centre, "shared_memory": False, "lease_s": self.lease_s, **given}
        )

    @model_validator(mode="after")
    def _centre_can_be_reached(self) -> Self:
        if self.centre:
            self.centre_bus()
        return self

    @field_validator("advertise")
    @classmethod
    def _can_be_connected_to(cls, endpoint: str | None) -> str | None:
        host = "" if endpoint is None else host_of(endpoint)
        if endpoint is not None and (port_of(endpoint) == "0" or is_unspecified(host)):
            raise ValueError(f"{endpoint!r} is not an address to connect to; write it like tcp/192.168.0.1:7447")
        return endpoint

    @model_validator(mode="before")
    @classmethod
    def _a_client_does_not_listen(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("mode") == "client":
            return {"listen": [], "connect": ["tcp/127.0.0.1:7447"], **given}
        return given


class UsersSettings(BaseModel):
    """Manage the users of a monitor. Passwords are prompted for, or read from standard input.

    `reset` gives another password or role and ends every session and token of theirs, as `remove` does; `token` prints
    a token for a program that does what this user may. A running monitor knows within seconds. Only `add` makes a
    database where there is none.
    """

    task: Annotated[Literal["add", "reset", "remove", "list", "token"], Field(description="what to do")]
    name: Annotated[str, Field(description="the user")] = ""
    role: Annotated[
        Role | None,
        Field(description="viewer: may only read; operator: may also act on alerts and robots (default: viewer)"),
    ] = None
    days: Annotated[float, Field(gt=0, le=3_650, description="days for which a token is valid")] = 365
    history: Annotated[
        HistoryUrl, Field(description="history database of the monitor; none if it keeps no history")
    ] = Field(default_factory=default_url)

    @model_validator(mode="after")
    def _role_only_where_it_applies(self, info: ValidationInfo) -> Self:
        if self.role is not None and "role" in given_as_options(self, info) and self.task not in {"add", "reset"}:
            raise ValueError(f"{self.task} takes no --role; only add and reset do")
        return self

    @model_validator(mode="after")
    def _days_only_for_a_token(self, info: ValidationInfo) -> Self:
        if "days" in given_as_options(self, info) and self.task != "token":
            raise ValueError(f"{self.task} takes no --days; only token does")
        return self


class RulesSettings(BaseModel):
    """Test a rule file on a monitor's history: print each alert that it would have raised.

    A mistake in the file is shown with its line.
    """

    task: Annotated[Literal["test"], Field(description="what to do")]
    file: Annotated[RegularFile, Field(description="the rule file")]
    history: Annotated[HistoryUrl, Field(description="history database of the monitor")] = Field(
        default_factory=default_url
    )
    since: Annotated[Moment | None, Field(description="skip what ended before this time (2026-11-20T06:00)")] = None
