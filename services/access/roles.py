"""Roles of a fleet: under which keys each may send, answer, ask, listen, and show or watch presence. Pure.

A permission on a key expression holds for messages whose own expression lies within it. `$*` stands for any text within
a chunk: a worker's name, and a consumer's, begins with the name of its certificate.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from schemas.keys import COLLECT
from schemas.worker_keys import ModelKey

ALL: Final = ("fleet/**", "workers/**", "services/**", "world/**", "warehouses/**")
"""Everything but the model registry."""

MODELS: Final = "models/**"

PRESENCE: Final = ("fleet/**", "workers/**", "fleet/*/@alive/*")
"""Presence tokens, also those that robots show in lists: `**` matches no chunk that begins with `@`."""

READ: Final = ("fleet/**", "workers/**")


class Role(StrEnum):
    """The purpose of a certificate. A robot's has no role in the file: its name is among the robots."""

    DETECTOR = "detector"
    SPACE = "space"
    WORLDMODEL = "worldmodel"
    MONITOR = "monitor"
    OPERATOR = "operator"
    OBSERVER = "observer"
    WAREHOUSE = "warehouse"
    ROUTER = "router"


@dataclass(frozen=True, slots=True)
class Permissions:
    """Key expressions by what may be done under them.

    sends: put, delete, answer queries. asks: queries. hears: subscriptions, and the queries for what is kept. shows:
    presence tokens. watches: others' presence. learns: that somebody subscribes or answers, which a process that is
    itself a router is told of.
    """

    sends: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    shows: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()
    learns: tuple[str, ...] = (*ALL, MODELS)

    def __or__(self, other: "Permissions") -> "Permissions":
        """Return what either permits."""
        return Permissions(
            *(
                tuple(dict.fromkeys((*getattr(self, name), *getattr(other, name))))
                for name in ("sends", "asks", "hears", "shows", "watches", "learns")
            )
        )


FOLLOWS_MODELS: Final = Permissions(asks=(ModelKey.LIST, ModelKey.PIECE), hears=(ModelKey.REGISTRY,), learns=())
"""Detectors, on robots too, read the model registry; only operators publish, put in force and go back."""


def of_robot(name: str) -> Permissions:
    """Return the permissions of a robot's gateway, and of all that connects through it: they speak for it alone."""
    return Permissions(
        sends=(f"fleet/{name}/**", f"workers/*/{name}-$*/status"),
        asks=(f"fleet/{name}/**",),
        hears=(f"fleet/{name}/**",),
        shows=(
            f"fleet/{name}/**",
            f"fleet/{name}/@alive/*",
            f"workers/*/{name}-$*/*/{name}/alive",
            f"workers/*/{name}-$*/serves/{name}/*",
        ),
        watches=(f"fleet/{name}/**", f"fleet/{name}/@alive/*", "workers/**"),
    )


def of_role(role: Role, name: str) -> Permissions:
    """Return the permissions of a role for who has the certificate of this name."""
    match role:
        case Role.DETECTOR:
            return (
                _worker(
                    name,
                    services=("detector", "opinion"),
                    results=("detections", "classes", "opinion", "overlay/detection", "overlay/segmentation"),
                    more=(f"services/detector/infer/{name}-$*",),
                )
                | FOLLOWS_MODELS
            )
        case Role.SPACE:
            return _worker(name, services=("distance", "cloud"), results=("distances", "view", "objects"))
        case Role.WORLDMODEL:
            return _worker(name, services=("worldmodel",), results=(), more=("world/**", "fleet/*/nearby"))
        case Role.WAREHOUSE:
            return Permissions(sends=(f"warehouses/{name}/**",), learns=("warehouses/**",))
        case Role.MONITOR | Role.OPERATOR:
            return OF_ALL[role] | Permissions(shows=(_wanted(f"{name}-$*"),), learns=())
        case _:
            return OF_ALL[role]


def _wanted(consumer: str) -> str:
    """Return the presence tokens of a consumer of any robot's streams."""
    return f"fleet/*/**/wanted/*/{consumer}"


OF_ALL: Final = {
    Role.MONITOR: Permissions(
        sends=("fleet/*/alerts", "fleet/*/actions", "services/monitor/**", MODELS),
        asks=(*ALL, ModelKey.LIST),
        hears=(*ALL, ModelKey.REGISTRY),
        watches=PRESENCE,
    ),
    Role.OPERATOR: Permissions(sends=(COLLECT,), asks=(*ALL, MODELS), hears=(*ALL, MODELS), watches=PRESENCE),
    Role.ROUTER: Permissions(
        sends=(*ALL, MODELS), asks=(*ALL, MODELS), hears=(*ALL, MODELS), shows=PRESENCE, watches=PRESENCE
    ),  # it passes on what it let in under the same rules
    Role.OBSERVER: Permissions(hears=("fleet/*/*/classes",), watches=("fleet/*/*/classes/alive",), learns=()),
}
"""Permissions that are the same whatever the certificate's name: all of a role's but for wanted tokens."""


def _worker(
    name: str, *, services: tuple[str, ...], results: tuple[str, ...], more: tuple[str, ...] = ()
) -> Permissions:
    """Return what workers may do: read the fleet, send their kind of results, and be present under their own names."""
    own = tuple(f"workers/{service}/{name}-$*" for service in services)
    consumers = (f"{name}-$*", f"opinion.{name}-$*")
    return Permissions(
        sends=(
            *(f"fleet/*/*/{result}" for result in results),
            *(f"fleet/*/*/budget/{consumer}" for consumer in consumers),
            *(f"{each}/{end}" for each in own for end in ("status", "settings")),
            *more,
        ),
        asks=(*READ, "world/**"),
        hears=(*READ, "world/**"),
        shows=(*map(_wanted, consumers), *(f"{each}/**" for each in own)),
        watches=PRESENCE,
    )
