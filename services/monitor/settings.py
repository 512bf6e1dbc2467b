"""Settings of the fleet monitor."""

from ipaddress import ip_address
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from bus.session.links import host_of, is_name
from bus.settings import BusSettings, Endpoint, port_of
from services.monitor.alerting.settings import AlertingSettings
from services.monitor.history.settings import HistorySettings
from services.monitor.inventory.settings import InventorySettings
from services.monitor.web.settings import WebSettings


class MonitorSettings(WebSettings, AlertingSettings, InventorySettings, HistorySettings, BusSettings):
    """Show what every robot of the fleet sees. The Zenoh router that the fleet connects to is part of it by default."""

    mode: Annotated[
        Literal["router", "peer", "client"],
        Field(description="part in the Zenoh network: 'router' takes connections itself, 'client' needs a router"),
    ] = "router"
    connect: Annotated[list[Endpoint], Field(description="Zenoh endpoints to connect to")] = []
    listen: Annotated[
        list[Endpoint], Field(description="Zenoh endpoints to listen on (tcp/0.0.0.0:7447 for other machines)")
    ] = ["tcp/127.0.0.1:7447"]
    advertise: Annotated[
        Endpoint | None,
        Field(description="endpoint that people are told to connect to, if it is not one of this machine's own"),
    ] = None
    refresh_s: Annotated[float, Field(ge=0.1, le=60, description="seconds between two pictures of the table")] = 0.5

    @field_validator("advertise")
    @classmethod
    def _can_be_connected_to(cls, endpoint: str | None) -> str | None:
        host = "" if endpoint is None else host_of(endpoint)
        if endpoint is not None and (
            port_of(endpoint) == "0" or (not is_name(host) and ip_address(host).is_unspecified)
        ):
            raise ValueError(f"{endpoint!r} is no address to connect to; write it like tcp/192.168.0.1:7447")
        return endpoint

    @model_validator(mode="before")
    @classmethod
    def _a_client_does_not_listen(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("mode") == "client":
            return {"listen": [], "connect": ["tcp/127.0.0.1:7447"], **given}
        return given
