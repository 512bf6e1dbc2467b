"""A real router, real certificates: what each role may send, answer and show; all else comes to nothing."""

import time
from collections.abc import Callable

import pytest
import zenoh

from services.access.roles import ALL, MODELS
from tests.services.access.links import (
    ANSWER_S,
    QUIET_S,
    Fleet,
    Seen,
    until_matching,
)

SENT = [
    ("r1", "fleet/r1/front/color", True),
    ("r1", "fleet/r1/status", True),
    ("r1", "workers/distance/r1-12-ab/status", True),
    ("r1", "fleet/r2/front/color", False),
    ("r1", "fleet/*/front/color", False),
    ("r1", "fleet/**", False),
    ("r1", "**", False),
    ("r1", "workers/distance/r2-12-ab/status", False),
    ("r1", "workers/detector/gpu1-12-ab/status", False),
    ("r1", "services/monitor/central/pulse", False),
    ("r1", "world/main/changes", False),
    ("r3", "fleet/r3/front/color", False),
    ("gpu1", "fleet/r1/front/classes", True),
    ("gpu1", "fleet/r2/front/overlay/detection", True),
    ("gpu1", "workers/detector/gpu1-12-ab/status", True),
    ("gpu1", "fleet/r1/front/budget/gpu1-12-ab", True),
    ("gpu1", "fleet/r1/front/budget/opinion.gpu1-12-ab", True),
    ("gpu1", "fleet/r1/front/budget/gpu2-12-ab", False),
    ("rack1", "fleet/r1/front/budget/gpu1-12-ab", False),
    ("ann", "fleet/r1/front/budget/ann-12-ab", False),
    ("gpu1", "fleet/r1/front/color", False),
    ("gpu1", "fleet/r1/actions", False),
    ("gpu1", "fleet/r1/alerts", False),
    ("gpu1", "fleet/r1/status", False),
    ("gpu1", "fleet/r1/front/distances", False),
    ("gpu1", "workers/detector/gpu2-12-ab/status", False),
    ("rack1", "fleet/r1/front/distances", True),
    ("rack1", "fleet/r1/front/objects", True),
    ("rack1", "fleet/r1/front/classes", False),
    ("rack1", "fleet/r1/nearby", False),
    ("world1", "world/main/changes", True),
    ("world1", "fleet/r1/nearby", True),
    ("world1", "fleet/r1/front/classes", False),
    ("world1", "fleet/r1/actions", False),
    ("central2", "fleet/r1/actions", True),
    ("central2", "fleet/r1/alerts", True),
    ("central2", "fleet/r1/front/classes", False),
    ("central2", "world/main/changes", False),
    ("ann", "fleet/r1/actions", False),
    ("ann", "fleet/r1/front/classes", False),
    ("wall", "fleet/r1/front/classes", False),
    ("wall", "services/monitor/central/pulse", False),
    ("berlin", "warehouses/berlin/report", True),
    ("berlin", "warehouses/lyon/report", False),
    ("berlin", "warehouses/**", False),
    ("berlin", "fleet/r1/actions", False),
    ("berlin", "world/main/changes", False),
    ("r1", "warehouses/berlin/report", False),
    ("central2", "warehouses/berlin/report", False),
    ("central2", "models/registry", True),
    ("ann", "models/registry", False),
    ("gpu1", "models/registry", False),
    ("stranger", "fleet/stranger/front/color", False),
]


@pytest.mark.parametrize(("name", "key", "allowed"), SENT)
@pytest.mark.parametrize("kind", ["put", "delete", "declared"])
def test_what_it_sends(fleet: Fleet, name: str, key: str, kind: str, allowed: bool) -> None:  # noqa: FBT001
    session = fleet.members[name]
    publisher = session.declare_publisher(key) if kind == "declared" else None
    act: Callable[[], object] = {
        "put": lambda: session.put(key, b"x"),
        "delete": lambda: session.delete(key),
        "declared": lambda: publisher and publisher.put(b"x"),
    }[kind]
    seen = Seen()
    subscribers = [fleet.central.declare_subscriber(expression, seen) for expression in (*ALL, MODELS)]
    try:
        if publisher is not None:
            until_matching(publisher, expected=allowed)
        heard = seen.after(act, expected=int(allowed))
        assert heard == ([key] if allowed else [])
    finally:
        for subscriber in subscribers:
            subscriber.undeclare()
        if publisher is not None:
            publisher.undeclare()


ANSWERED = [
    ("berlin", "warehouses/berlin/world/main/objects", True),
    ("berlin", "warehouses/lyon/world/main/objects", False),
    ("berlin", "fleet/r1/clock", False),
    ("r1", "fleet/r1/clock", True),
    ("r1", "fleet/r2/clock", False),
    ("r1", "services/monitor/inventory", False),
    ("r1", "world/main/objects", False),
    ("gpu1", "services/detector/infer/gpu1-12-ab", True),
    ("gpu1", "workers/detector/gpu1-12-ab/settings", True),
    ("gpu1", "services/detector/infer/gpu2-12-ab", False),
    ("gpu1", "fleet/r1/clock", False),
    ("rack1", "fleet/r1/service/reset", False),
    ("world1", "world/main/objects", True),
    ("world1", "services/monitor/inventory", False),
    ("central2", "services/monitor/inventory", True),
    ("ann", "services/monitor/inventory", False),
    ("ann", "services/collect", True),
    ("gpu1", "services/collect", False),
    ("r1", "services/collect", False),
    ("wall", "services/collect", False),
    ("wall", "world/main/objects", False),
    ("central2", "models/piece", True),
    ("gpu1", "models/piece", False),
    ("ann", "models/use", False),
    ("stranger", "fleet/r1/clock", False),
]


@pytest.mark.parametrize(("name", "key", "allowed"), ANSWERED)
def test_what_it_answers(fleet: Fleet, name: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    queryable = fleet.members[name].declare_queryable(key, lambda query: query.reply(key, b"x"))
    end = time.monotonic() + (10 if allowed else QUIET_S)
    replies: list[str] = []
    try:
        while not replies and time.monotonic() < end:
            replies = [str(reply.ok.key_expr) for reply in fleet.central.get(key, timeout=ANSWER_S) if reply.ok]
        assert replies == ([key] if allowed else [])
    finally:
        queryable.undeclare()


@pytest.mark.parametrize(("name", "allowed"), [("r1", True), ("rack1", False), ("ann", False)])
def test_what_a_robot_keeps_is_had_from_one_queryable(fleet: Fleet, name: str, allowed: bool) -> None:  # noqa: FBT001
    key = "fleet/r1/front/info"
    queryable = fleet.members[name].declare_queryable("fleet/r1/**/@adv/pub/1/**", lambda query: query.reply(key, b"x"))
    end = time.monotonic() + (10 if allowed else QUIET_S)
    replies: list[str] = []
    try:
        while not replies and time.monotonic() < end:
            found = fleet.central.get(f"{key}/@adv/pub/1/2/_", accept_replies=zenoh.ReplyKeyExpr.ANY, timeout=ANSWER_S)
            replies = [str(reply.ok.key_expr) for reply in found if reply.ok]
        assert replies == ([key] if allowed else [])
    finally:
        queryable.undeclare()


SHOWN = [
    ("r1", "fleet/r1/alive", True),
    ("r1", "fleet/r1/front/color/alive", True),
    ("r1", "workers/distance/r1-12-ab/1/r1/alive", True),
    ("r1", "workers/distance/r1-12-ab/serves/r1/front", True),
    ("r1", "fleet/r1/@alive/alive,front:color:alive", True),
    ("r1", "fleet/r2/alive", False),
    ("r1", "fleet/r2/@alive/alive", False),
    ("r1", "fleet/r2/front/color/wanted/here/x", False),
    ("r1", "workers/distance/r1-12-ab/1000/-/alive", False),
    ("r1", "workers/distance/r1-12-ab/1/r2/alive", False),
    ("r1", "workers/detector/gpu1-12-ab/serves/r2/front", False),
    ("r1", "workers/detector/gpu1-12-ab/serves/r1/front", False),
    ("r1", "workers/distance/r2-12-ab/1/r1/alive", False),
    ("rack1", "workers/distance/rack1-12-ab/1/-/alive", True),
    ("rack1", "workers/cloud/rack1-12-ab/serves/r1/front", True),
    ("rack1", "workers/distance/rack2-12-ab/1/-/alive", False),
    ("rack1", "workers/detector/rack1-12-ab/1/-/alive", False),
    ("rack1", "fleet/r1/front/distances/alive", False),
    ("berlin", "fleet/r1/alive", False),
    ("berlin", "workers/detector/berlin-12-ab/1/-/alive", False),
    ("central2", "workers/detector/central2-12-ab/1/-/alive", False),
    ("ann", "workers/detector/ann-12-ab/1/-/alive", False),
    ("ann", "workers/distance/ann-12-ab/serves/r1/front", False),
    ("world1", "workers/detector/world1-12-ab/1/-/alive", False),
    ("world1", "workers/worldmodel/world2-12-ab/1/-/alive", False),
    ("r3", "fleet/r3/alive", False),
    ("gpu1", "workers/detector/gpu1-12-ab/1/-/alive", True),
    ("gpu1", "fleet/r1/front/color/wanted/here/gpu1-12-ab", True),
    ("gpu1", "fleet/r1/front/color/wanted/here/opinion.gpu1-12-ab", True),
    ("gpu1", "fleet/r1/front/color/wanted/here/gpu2-12-ab", False),
    ("gpu1", "fleet/r1/front/color/wanted/here/opinion.gpu2-12-ab", False),
    ("gpu1", "fleet/r1/front/color/wanted/here/x", False),
    ("rack1", "fleet/r1/front/depth/wanted/here/rack1-12-ab", True),
    ("rack1", "fleet/r1/tf/wanted/here/rack1-12-ab", True),
    ("rack1", "fleet/r1/tf/wanted/here/gpu1-12-ab", False),
    ("world1", "fleet/r1/tf/wanted/here/world1-12-ab", True),
    ("world1", "fleet/r1/tf/wanted/here/rack1-12-ab", False),
    ("central2", "fleet/r1/tf/wanted/here/gpu1-12-ab", False),
    ("ann", "fleet/r1/front/color/wanted/here/ann-12ab", True),
    ("ann", "fleet/r1/front/color/wanted/here/gpu1-12-ab", False),
    ("berlin", "fleet/r1/front/color/wanted/here/berlin-12-ab", False),
    ("r1", "fleet/r1/front/color/wanted/here/12ab", True),
    ("gpu1", "workers/detector/gpu2-12-ab/1/-/alive", False),
    ("gpu1", "workers/distance/gpu1-12-ab/1/-/alive", False),
    ("gpu1", "fleet/r1/alive", False),
    ("gpu1", "fleet/r1/front/color/alive", False),
    ("gpu1", "fleet/r1/@alive/front:color:alive", False),
    ("ann", "fleet/r1/@alive/front:color:alive", False),
    ("world1", "workers/worldmodel/world1-12-ab/1/-/alive", True),
    ("world1", "fleet/r1/alive", False),
    ("central2", "fleet/r1/tf/wanted/here/central2-12ab", True),
    ("central2", "fleet/r1/alive", False),
    ("ann", "fleet/r1/alive", False),
    ("wall", "fleet/r1/front/color/wanted/here/wall-12ab", False),
    ("wall", "workers/detector/wall-12-ab/1/-/alive", False),
    ("stranger", "fleet/stranger/alive", False),
]


@pytest.mark.parametrize(("name", "key", "allowed"), SHOWN)
def test_what_presence_it_shows(fleet: Fleet, name: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    seen = Seen()
    lists = "fleet/*/@alive/*"  # which ** does not match
    watching = fleet.central.liveliness().declare_subscriber(lists if "@" in key else "**", seen)
    tokens: list[zenoh.LivelinessToken] = []
    try:
        shown = seen.after(
            lambda: tokens.append(fleet.members[name].liveliness().declare_token(key)), expected=int(allowed)
        )
        assert shown == ([key] if allowed else [])
    finally:
        for token in tokens:
            token.undeclare()
        watching.undeclare()
        fleet.wait_until_nobody_is_present()
