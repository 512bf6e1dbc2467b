"""Settings of work sharing. Plain data: the caller reads environment, files and arguments."""

import os
import secrets
import socket
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BaseModel, Field

from schemas.keys import NAME, check_name
from schemas.worker_keys import MAX_WEIGHT, MIN_WEIGHT, WorkerAlive, parse_worker_alive

MAX_OWNER = 50
"""Letters of a worker's name that say whose it is."""


def default_worker_name(settings: Mapping[str, Any]) -> str:
    """Return a unique worker name from process id and, since containers share those, a random part.

    It begins with the name under which routers with access rules know the process: its certificate's file name, or its
    robot's where it has no certificate and serves one robot; else with the host's.
    """
    certificate, robots = settings.get("tls_certificate"), settings.get("robots", [])
    owner = certificate.stem if certificate else robots[0] if len(robots) == 1 else machine_name(socket.gethostname())
    known = owner if NAME.fullmatch(owner) and len(owner) <= MAX_OWNER else machine_name(owner)
    return f"{known}-{os.getpid()}-{secrets.token_hex(2)}"


def machine_name(host: str) -> str:
    """Return the host name without characters that a key cannot contain."""
    machine = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in host).strip("-")
    return machine[:MAX_OWNER] or "worker"


def _named(what: str) -> AfterValidator:
    def check(name: str) -> str:
        check_name(what, name)
        return name

    return AfterValidator(check)


RobotName = Annotated[str, _named("robot")]
WorkerName = Annotated[str, _named("worker")]


class SharingSettings(BaseModel):
    """Settings of every process that shares the fleet's cameras with others of its kind."""

    heading: ClassVar = "sharing the work"

    robots: list[RobotName] = Field(
        default=[],
        max_length=100,
        description="serve only these robots, with priority over workers for any robot; any robot by default",
    )
    worker: WorkerName = Field(default_factory=default_worker_name, description="this worker's name")
    weight: float = Field(
        default=1.0,
        ge=MIN_WEIGHT,
        le=MAX_WEIGHT,
        description="this worker's weight when cameras are shared: with 2 it gets twice as many as with 1",
    )

    def tokens(self, service: str) -> list[WorkerAlive]:
        """Return the worker's presence tokens, as others read them."""
        told = (WorkerAlive(service, self.worker, self.weight, robot) for robot in self.robots or (None,))
        return [parse_worker_alive(str(token)) for token in told]
