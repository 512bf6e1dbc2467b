"""Zenoh's access control for a fleet: default deny, a subject per certificate name. Pure.

Zenoh (1.10) compares a certificate's common name with a subject's whole, knows no patterns there, and reads rules when
a router starts. `**` never matches a chunk that begins with `@`, so what advanced publishers keep needs expressions of
its own. https://zenoh.io/docs/manual/access-control/
"""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from services.access.fleet_file import FleetFile
from services.access.roles import FOLLOWS_MODELS, Permissions, of_robot, of_role

SAYING: Final = ("put", "delete", "reply", "declare_queryable")
HEARING: Final = ("declare_subscriber", "query")
TOKENS: Final = ("liveliness_token",)
WATCHING: Final = ("declare_liveliness_subscriber", "liveliness_query")
LEARNING: Final = ("declare_subscriber", "declare_queryable", "query")
ARRIVING: Final = ("put", "delete", "reply")

IN: Final = ("ingress",)
OUT: Final = ("egress",)

Rule = dict[str, Any]


def access_control(fleet: FleetFile) -> dict[str, Any]:
    """Return Zenoh's `access_control`, as its configuration has it."""
    rules: dict[tuple[Any, ...], Rule] = {}
    subjects, policies = [], []
    for name, permitted in _by_name(fleet).items():
        every = (rule for permissions in permitted for rule in _rules_of(permissions))
        used = [_shared(rules, *rule) for rule in every if rule[2]]  # Zenoh takes no empty ones
        subjects.append({"id": name, "cert_common_names": [name]})
        policies.append({"subjects": [name], "rules": used})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": list(rules.values()),
        "subjects": subjects,
        "policies": policies,
    }


def _by_name(fleet: FleetFile) -> Mapping[str, tuple[Permissions, ...]]:
    """Return each name's permissions; rules of what all robots may do alike are there once."""
    found: dict[str, tuple[Permissions, ...]] = {
        robot: (of_robot(robot), FOLLOWS_MODELS) for robot in fleet.robot_names()
    }
    for name, roles in fleet.roles.items():
        permissions = Permissions(learns=())
        for role in roles:
            permissions |= of_role(role, name)
        found[name] = (permissions,)
    return {name: permitted for name, permitted in found.items() if name not in fleet.denied_names()}


def _rules_of(permissions: Permissions) -> Iterable[tuple[tuple[str, ...], tuple[str, ...], list[str]]]:
    """Yield kinds of messages, the way that they go, and key expressions."""
    yield SAYING, IN, _kept(permissions.sends)
    yield HEARING, IN, _kept(permissions.hears)
    yield ("query",), IN, list(permissions.asks)
    yield TOKENS, IN, [*permissions.shows, *_aside(permissions.sends)]
    yield WATCHING, IN, [*permissions.watches, *_aside(permissions.hears)]
    yield LEARNING, OUT, _kept(permissions.learns)
    yield ARRIVING, OUT, [*_kept((*permissions.hears, *permissions.asks))]
    yield (*TOKENS, *WATCHING), OUT, [*permissions.watches, *_aside(permissions.hears), *_aside(permissions.sends)]


def _kept(expressions: Iterable[str]) -> list[str]:
    """Return expressions and those of what advanced publishers keep under them."""
    known = list(dict.fromkeys(expressions))
    return [*known, *_aside(known)]


def _aside(expressions: Iterable[str]) -> list[str]:
    return [f"{expression}/@adv/**" for expression in dict.fromkeys(expressions)]


def _shared(
    rules: dict[tuple[Any, ...], Rule], messages: tuple[str, ...], flows: tuple[str, ...], keys: list[str]
) -> str:
    """Return the id of a rule, which many may have in common."""
    of = (messages, flows, tuple(dict.fromkeys(keys)))
    if of not in rules:
        rules[of] = {
            "id": f"rule-{len(rules) + 1}",
            "permission": "allow",
            "messages": list(messages),
            "flows": list(flows),
            "key_exprs": list(of[2]),
        }
    return str(rules[of]["id"])
