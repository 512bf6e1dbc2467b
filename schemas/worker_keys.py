"""Keys of services and their workers: `workers/{service}/{worker}/...`, and of sites: `world/{site}/...`.

A warehouse's reports to its centre are below `warehouses/{warehouse}/...`, the model registry below `models/`.

`schemas.keys` has those of robots.
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from schemas.errors import SchemaError
from schemas.keys import ALIVE, CameraKey, check_name

DETECTOR: Final = "detector"
"""The service of workers whose class lists count."""

OPINION: Final = "opinion"
"""The service of workers that give a second opinion, which only rules on disagreement use."""

SERVES: Final = "serves"

WEIGHT: Final = re.compile(r"[0-9]{1,4}(?:\.[0-9]{1,9})?")
MIN_WEIGHT: Final = 0.01
MAX_WEIGHT: Final = 1000.0

ANY_ROBOT: Final = "-"
"""Placeholder for a robot in a worker's presence; no robot can have this name."""

EVERY_WORKER_STATUS: Final = "workers/*/*/status"


def worker_status(service: str, worker: str) -> str:
    """Return the key of a worker's WorkerStatus."""
    check_name("service", service)
    check_name("worker", worker)
    return f"workers/{service}/{worker}/status"


def every_worker_status(service: str) -> str:
    """Return the key expression of the statuses of a service's workers."""
    check_name("service", service)
    return f"workers/{service}/*/status"


def worker_settings(service: str, worker: str) -> str:
    """Return the key under which a worker accepts new settings while it runs."""
    check_name("service", service)
    check_name("worker", worker)
    return f"workers/{service}/{worker}/settings"


class WorldStream(StrEnum):
    """The last chunk of a site's keys.

    CHANGES: WorldChanges. STATUS: SiteStatus. OBJECTS: a world model answers a WorldRequest with a WorldAnswer. FLOOR:
    it answers an empty request with a FloorLooks. STATE: its state, for workers that stand by; only they know its form.
    """

    CHANGES = "changes"
    OBJECTS = "objects"
    FLOOR = "floor"
    STATUS = "status"
    STATE = "state"


EVERY_WORLD_STATUS: Final = f"world/*/{WorldStream.STATUS}"


def world_key(site: str, stream: WorldStream) -> str:
    """Return a key of a site."""
    check_name("site", site)
    return f"world/{site}/{stream}"


def parse_world(key: str) -> tuple[str, WorldStream]:
    """Return the site and the stream of a `world/{site}/{stream}` key.

    Raises:
        SchemaError: the key is not of that form.
    """
    match key.split("/"):
        case ["world", site, stream] if stream in set(WorldStream):
            check_name("site", site)
            return site, WorldStream(stream)
    raise SchemaError(f"not a site's key: {key[:200]!r}")


class ModelKey(StrEnum):
    """The keys of the model registry.

    REGISTRY: ModelRegistry, whenever it changes and every few seconds. LIST: answers an empty request with it. PIECE:
    answers a ModelPieceRequest with a ModelPiece. PUBLISH: answers a ModelUpload with a ModelUploadAnswer. USE: answers
    a ModelUse with the changed ModelRegistry.
    """

    REGISTRY = "models/registry"
    LIST = "models/list"
    PIECE = "models/piece"
    PUBLISH = "models/publish"
    USE = "models/use"


EVERY_WAREHOUSE_REPORT: Final = "warehouses/*/report"


def warehouse_report(warehouse: str) -> str:
    """Return the key of a warehouse's WarehouseReport."""
    check_name("warehouse", warehouse)
    return f"warehouses/{warehouse}/report"


def warehouse_objects(warehouse: str, site: str) -> str:
    """Return the key under which a warehouse's monitor answers a WorldRequest about one of its sites.

    The answer is a WorldAnswer, as its world model gives it.
    """
    check_name("warehouse", warehouse)
    check_name("site", site)
    return f"warehouses/{warehouse}/world/{site}/objects"


def every_warehouse_objects(warehouse: str) -> str:
    """Return the key expression of these requests about any site of a warehouse."""
    check_name("warehouse", warehouse)
    return f"warehouses/{warehouse}/world/*/objects"


def parse_warehouse_report(key: str) -> str:
    """Return the warehouse of a report's key.

    Raises:
        SchemaError: the key is none.
    """
    match key.split("/"):
        case ["warehouses", warehouse, "report"]:
            check_name("warehouse", warehouse)
            return warehouse
    raise SchemaError(f"not the key of a warehouse's report: {key[:200]!r}")


def parse_warehouse_objects(key: str) -> tuple[str, str]:
    """Return the warehouse and the site of the key of a request for objects.

    Raises:
        SchemaError: the key is none.
    """
    match key.split("/"):
        case ["warehouses", warehouse, "world", site, "objects"] if warehouse_objects(warehouse, site) == key:
            return warehouse, site
    raise SchemaError(f"not the key of a site's objects: {key[:200]!r}")


def infer(worker: str) -> str:
    """Return the key under which a detector worker answers an image with its Detections."""
    check_name("worker", worker)
    return f"services/detector/infer/{worker}"


@dataclass(frozen=True, slots=True)
class WorkerAlive:
    """A worker's presence. Tokens have no payload, so the key holds everything that others need to know.

    weight: its share of the work beside others', above 0. robot: the one it is for, before all workers that are for
    any; None for any. A worker that is for several robots has a token for each.

    Raises:
        SchemaError: a name that cannot be a chunk of a key, or a weight out of MIN_WEIGHT to MAX_WEIGHT.
    """

    service: str
    worker: str
    weight: float = 1.0
    robot: str | None = None

    def __post_init__(self) -> None:
        check_name("service", self.service)
        check_name("worker", self.worker)
        if self.robot is not None:
            check_name("robot", self.robot)
        if not MIN_WEIGHT <= self.weight <= MAX_WEIGHT:
            raise SchemaError(f"a worker's weight of {self.weight:g}: use {MIN_WEIGHT:g} to {MAX_WEIGHT:g}")

    def __str__(self) -> str:
        return f"workers/{self.service}/{self.worker}/{self.weight:g}/{self.robot or ANY_ROBOT}/{ALIVE}"


def every_worker_alive(service: str) -> str:
    """Return the key expression of the presence tokens of a service's workers."""
    check_name("service", service)
    return f"workers/{service}/*/*/*/{ALIVE}"


def parse_worker_alive(key: str) -> WorkerAlive:
    """Parse a worker's presence token.

    Raises:
        SchemaError: the key is none.
    """
    match key.split("/"):
        case ["workers", service, worker, weight, robot, last] if last == ALIVE and WEIGHT.fullmatch(weight):
            return WorkerAlive(service, worker, float(weight), None if robot == ANY_ROBOT else robot)
    raise SchemaError(f"not a worker's presence: {key[:200]!r}")


@dataclass(frozen=True, slots=True)
class Serves:
    """A worker's declaration that it has taken a camera over: results have arrived, or none are wanted.

    Raises:
        SchemaError: a name that cannot be a chunk of a key.
    """

    service: str
    worker: str
    camera: CameraKey

    def __post_init__(self) -> None:
        check_name("service", self.service)
        check_name("worker", self.worker)

    def __str__(self) -> str:
        return f"workers/{self.service}/{self.worker}/{SERVES}/{self.camera}"


def every_serves(service: str) -> str:
    """Return the key expression of a service's tokens for cameras taken over."""
    check_name("service", service)
    return f"workers/{service}/*/{SERVES}/*/*"


def parse_serves(key: str) -> Serves:
    """Parse a token for a camera that was taken over.

    Raises:
        SchemaError: the key is none.
    """
    match key.split("/"):
        case ["workers", service, worker, what, robot, camera] if what == SERVES:
            return Serves(service, worker, CameraKey(robot, camera))
    raise SchemaError(f"not the key of a camera that was taken over: {key[:200]!r}")


def parse_worker(key: str) -> tuple[str, str]:
    """Return (service, worker) of any `workers/{service}/{worker}/...` key.

    Raises:
        SchemaError: the key is not of that form.
    """
    match key.split("/"):
        case ["workers", service, worker, *_]:
            check_name("service", service)
            check_name("worker", worker)
            return service, worker
    raise SchemaError(f"not a worker's key: {key[:200]!r}")
