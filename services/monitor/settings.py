"""Settings of the fleet monitor."""

from typing import Annotated, Literal

from pydantic import Field

from bus.settings import BusSettings


class MonitorSettings(BusSettings):
    """Show what every robot of the fleet sees. The Zenoh router that the fleet connects to is part of it by default."""

    mode: Annotated[
        Literal["router", "peer", "client"],
        Field(description="part in the Zenoh network: 'router' takes connections itself, 'client' needs a router"),
    ] = "router"
    connect: Annotated[list[str], Field(description="Zenoh endpoints to connect to")] = []
    listen: Annotated[
        list[str], Field(description="Zenoh endpoints to listen on (tcp/0.0.0.0:7447 for other machines)")
    ] = ["tcp/127.0.0.1:7447"]
    refresh_s: Annotated[float, Field(ge=0.1, le=60, description="seconds between two pictures of the table")] = 0.5
