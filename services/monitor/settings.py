"""Settings of the fleet monitor."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from bus.settings import BusSettings, Endpoint
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
    refresh_s: Annotated[float, Field(ge=0.1, le=60, description="seconds between two pictures of the table")] = 0.5

    @model_validator(mode="before")
    @classmethod
    def _a_client_does_not_listen(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("mode") == "client":
            return {"listen": [], "connect": ["tcp/127.0.0.1:7447"], **given}
        return given
