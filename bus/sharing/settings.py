"""Settings of work sharing, validated; the default worker name reads the host name and the process id."""

import os
import secrets
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BaseModel, Field, model_validator

from schemas.keys import NAME, check_name
from schemas.worker_keys import MAX_WEIGHT, MIN_WEIGHT, WorkerAlive, parse_worker_alive

MAX_OWNER = 50
"""Letters of a worker's name that say whose it is."""


def default_worker_name(owner: str = "") -> str:
    """Return a unique worker name from process id and, since containers share those, a random part.

    owner: what it begins with, else the host's name.
    """
    known = owner if NAME.fullmatch(owner) and len(owner) <= MAX_OWNER else machine_name(owner or socket.gethostname())
    return f"{known}-{os.getpid()}-{secrets.token_hex(2)}"


def owner_of(given: Mapping[str, Any]) -> str:
    """Return the name under which routers with access rules know the process of some settings, as far as it is known.

    That is its certificate's, or its robot's where it has none and serves one robot.
    """
    if certificate := given.get("tls_certificate"):
        return Path(certificate).stem
    if short := given.get("tls"):
        return Path(short).name
    match given.get("robots"):
        case [str(robot)]:
            return robot
    return ""


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


class WorkerSettings(BaseModel):
    """The name of a worker."""

    heading: ClassVar = "sharing the work"

    worker: WorkerName = Field(
        default_factory=default_worker_name,
        description="this worker's name; it begins with its certificate's or its only robot's name, if it has one",
    )

    @model_validator(mode="before")
    @classmethod
    def _is_named_as_routers_know_it(cls, given: Any) -> Any:
        if isinstance(given, dict) and "worker" not in given and (owner := owner_of(given)):
            return {**given, "worker": default_worker_name(owner)}
        return given


class SharingSettings(WorkerSettings):
    """Settings of every process that shares the fleet's cameras with others of its kind."""

    heading: ClassVar = "sharing the work"

    robots: list[RobotName] = Field(
        default=[],
        max_length=100,
        description="serve only these robots, with priority over workers for any robot; any robot by default",
    )
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
