"""Settings of the monitor's page and HTTP API."""

from typing import ClassVar

from pydantic import BaseModel, Field, HttpUrl, field_validator

from services.monitor.regular_file import RegularFile


class WebSettings(BaseModel):
    """Where the page is, and for how long somebody is logged in."""

    heading: ClassVar = "page and HTTP API"

    web: bool = Field(default=True, description="serve the page and the HTTP API")
    web_host: str = Field(
        default="127.0.0.1", min_length=1, description="address to serve them at; 0.0.0.0 is all of this machine's"
    )
    web_port: int = Field(default=8080, ge=0, le=65535, description="port to serve them at; 0 takes a free one")
    web_url: HttpUrl | None = Field(
        default=None, description="address that people use if a proxy is before it, like https://fleet.example"
    )
    floor_plan: RegularFile | None = Field(
        default=None, description="floor plan to draw the map on: the YAML file of a map as ROS's map_server has it"
    )
    web_session_hours: float = Field(
        default=168, gt=0, le=8_760, description="hours after which somebody who did nothing is logged out"
    )
    web_connections: int = Field(default=1_000, ge=10, le=100_000, description="connections at the same time, at most")
    web_open_metrics: bool = Field(default=False, description="let anybody read /metrics, without a token")

    @field_validator("web_url")
    @classmethod
    def _is_a_whole_host(cls, url: HttpUrl | None) -> HttpUrl | None:
        if url is not None and (url.path not in (None, "/") or url.query is not None or url.fragment is not None):
            raise ValueError(
                "the page is at the root of its host: nothing may follow that, as in https://fleet.example"
            )
        return url
