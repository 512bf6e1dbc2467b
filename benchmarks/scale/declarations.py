"""What a robot declares, as its router says."""

import json
from collections.abc import Iterable
from typing import Final

import zenoh

from benchmarks.gateway.flow import free_endpoint
from benchmarks.gateway.processes import module, running
from benchmarks.scale.fleet import Kind
from bus import BusSettings
from bus.session.config import session_config

ANSWER_S: Final = 60.0
KINDS: Final = ("publisher", "subscriber", "queryable")

UNLISTED: Final = {"caches": 1, "watches": 1}
"""The queryable for all that a robot keeps, and its watch of subscribers: a router's admin space lists neither."""

TOKENS: Final = ("**", "**/@adv/**", "**/@alive/**")
"""Key expressions that match all tokens: `**` alone matches no chunk that begins with `@`."""


def declarations(kind: Kind) -> dict[str, int]:
    """Return how many of each kind one robot has at a router of its own."""
    endpoint = free_endpoint()
    settings = BusSettings(mode="router", listen=[endpoint], shared_memory=False)
    config = session_config(settings) | {"adminspace": {"enabled": True, "permissions": {"read": True}}}
    with (
        zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as router,
        running(module("gateways", endpoint, "0", kind)) as peer,
    ):
        peer.tell("robots 1")
        peer.answer(ANSWER_S)
        found = {f"{kind}s": len(_keys(router.get(f"@/*/router/{kind}/**"))) for kind in KINDS}
        tokens = [_keys(router.liveliness().get(expression)) for expression in TOKENS]
    return {**found, "tokens": len(set[str]().union(*tokens)), **UNLISTED}


def _keys(replies: Iterable[zenoh.Reply]) -> set[str]:
    return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
