"""A router's access rules: reads them, and refuses to let everybody in unless that is meant."""

import gzip
import json
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, Final

from bus.errors import BusError
from bus.session.links import is_loopback
from bus.settings import WITH_TLS, BusSettings

_GZIP: Final = b"\x1f\x8b"

RULES: Final = frozenset({"enabled", "default_permission", "rules", "subjects", "policies"})
"""Fields of Zenoh's access control."""


def open_endpoints(settings: BusSettings) -> list[str]:
    """Return the endpoints at which other machines may do anything: without certificates, or rules for them."""
    safe = WITH_TLS if settings.access is not None else ()
    return [each for each in settings.listen if not (each.startswith(safe) or is_loopback(each))]


def check_closed(settings: BusSettings) -> None:
    """Check that no other machine is let in unless certificates and rules say who it is.

    Raises:
        BusError: one is, and nobody said that this is meant.
    """
    if settings.insecure or not (endpoints := open_endpoints(settings)):
        return
    first = endpoints[0]
    if first.startswith(WITH_TLS):
        risk, cure = "whoever has a certificate of the fleet could send as any robot", "give rules with --access"
    else:
        risk, cure = "anybody who reaches it could send as any robot, and read everything", "use tls/ and --access"
    raise BusError(f"listen {first}: {risk}; {cure} (docs/security.md), or --insecure where nobody else gets there")


def read_access(settings: BusSettings) -> Mapping[str, Any] | None:
    """Return the rules of a router's access control, None if it has none. The file may be compressed by gzip.

    Raises:
        BusError: they cannot be read.
    """
    if settings.access is None:
        return None
    said = f"access {settings.access}"
    try:
        content = settings.access.read_bytes()
        rules = json.loads(gzip.decompress(content) if content.startswith(_GZIP) else content)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise BusError(f"{said}: its compression is damaged: {error}") from error
    except OSError as error:
        raise BusError(f"{said}: {error.strerror or error}") from error
    except ValueError as error:
        raise BusError(
            f"{said}: no JSON; `fleetsight access fleet.yaml --to {settings.access.name}` makes it"
        ) from error
    if not isinstance(rules, dict) or not rules.keys() >= RULES:
        raise BusError(f"{said}: no rules; `fleetsight access fleet.yaml --to {settings.access.name}` makes them")
    return rules


def of_one_machine(access: Mapping[str, Any]) -> frozenset[str]:
    """Return the names whose certificates are each for one machine: all but those that are workers' alone.

    Workers that share the work may share a certificate. They present themselves under their names, and ask nothing of
    all services, as monitors, operators and routers do. Neighbours of a robot's gateway act as the robot.
    """
    return frozenset(name for name, keys in _taken_in(access) if not _is_a_workers(name, keys))


def _is_a_workers(name: str, keys: frozenset[str]) -> bool:
    is_present = any(key.startswith("workers/") and f"/{name}-$*/" in key for key in keys)
    return is_present and "services/**" not in keys and f"fleet/{name}/**" not in keys


def _taken_in(access: Mapping[str, Any]) -> Iterator[tuple[str, frozenset[str]]]:
    """Yield each name, and the key expressions of what is let in from it."""
    names = {subject.get("id"): subject.get("cert_common_names") or () for subject in access["subjects"] or ()}
    rules = {
        rule.get("id"): rule.get("key_exprs") or ()
        for rule in access["rules"] or ()
        if "ingress" in (rule.get("flows") or ("ingress",))
    }
    for policy in access["policies"] or ():
        keys = frozenset(key for each in policy.get("rules") or () for key in rules.get(each, ()))
        yield from ((name, keys) for each in policy.get("subjects") or () for name in names.get(each, ()))


def names_in(access: Mapping[str, Any]) -> frozenset[str]:
    """Return the certificates' names that rules allow something."""
    subjects = access["subjects"] or ()
    return frozenset(name for subject in subjects for name in subject.get("cert_common_names") or ())
