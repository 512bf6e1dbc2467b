"""A real router, real certificates: what each role may hear, ask and watch; all else stays secret."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh
from zenoh.ext import (
    AdvancedPublisher,
    CacheConfig,
    HistoryConfig,
    MissDetectionConfig,
    declare_advanced_publisher,
    declare_advanced_subscriber,
)

from tests.services.access.links import PATIENCE_S, Fleet, Seen, fence
from tests.services.access.rights import ASKS, HEARS, MEMBERS, MESSAGES, TOKENS, WATCHES, cases, with_all
from tests.services.access.rights import sentinel as sentinel_of

HEARD = [
    ("r1", "fleet/r1/actions", "fleet/r1/actions", True),
    ("r1", "fleet/r1/**", "fleet/r1/front/classes", True),
    ("r1", "fleet/r2/front/classes", "fleet/r2/front/classes", False),
    ("r1", "fleet/*/front/classes", "fleet/r2/front/classes", False),
    ("r1", "fleet/**", "fleet/r2/front/color", False),
    ("r1", "**", "fleet/r2/front/color", False),
    ("r1", "workers/**", "workers/detector/gpu1-12-ab/status", False),
    ("r1", "world/**", "world/main/changes", False),
    ("berlin", "**", "fleet/r2/front/classes", False),
    ("berlin", "warehouses/**", "warehouses/lyon/report", False),
    ("r1", "warehouses/**", "warehouses/berlin/report", False),
    ("central2", "warehouses/*/report", "warehouses/berlin/report", True),
    ("r3", "fleet/r3/**", "fleet/r3/actions", False),
    ("gpu1", "fleet/*/*/color", "fleet/r2/front/color", True),
    ("rack1", "fleet/*/*/depth", "fleet/r2/front/depth", True),
    ("rack1", "services/monitor/**", "services/monitor/central/pulse", False),
    ("rack1", "warehouses/**", "warehouses/berlin/report", False),
    ("gpu1", "services/monitor/**", "services/monitor/central/pulse", False),
    ("gpu1", "warehouses/**", "warehouses/berlin/report", False),
    ("world1", "services/monitor/**", "services/monitor/central/pulse", False),
    ("world1", "warehouses/**", "warehouses/berlin/report", False),
    ("world1", "models/registry", "models/registry", False),
    ("berlin", "models/registry", "models/registry", False),
    ("berlin", "world/**", "world/main/changes", False),
    ("wall", "world/**", "world/main/changes", False),
    ("wall", "warehouses/**", "warehouses/berlin/report", False),
    ("world1", "fleet/*/*/view", "fleet/r2/front/view", True),
    ("world1", "world/main/state", "world/main/state", True),
    ("central2", "fleet/*/*/classes", "fleet/r2/front/classes", True),
    ("ann", "fleet/*/*/classes", "fleet/r2/front/classes", True),
    ("wall", "fleet/*/*/classes", "fleet/r2/front/classes", True),
    ("wall", "fleet/r2/front/classes", "fleet/r2/front/classes", True),
    ("wall", "fleet/*/*/color", "fleet/r2/front/color", False),
    ("wall", "fleet/*/*/*", "fleet/r2/front/classes", False),
    ("wall", "fleet/**", "fleet/r2/front/classes", False),
    ("wall", "workers/**", "workers/detector/gpu1-12-ab/status", False),
    ("gpu1", "models/registry", "models/registry", True),
    ("r1", "models/registry", "models/registry", True),
    ("rack1", "models/registry", "models/registry", False),
    ("central2", "models/registry", "models/registry", True),
    ("stranger", "fleet/**", "fleet/r2/front/classes", False),
]


def heard(fleet: Fleet, name: str, expression: str, key: str) -> list[str]:
    """Return what a member hears of a message."""
    seen, session = Seen(), fleet.members[name]
    with session.declare_subscriber(expression, seen.at_once):
        fence(session)
        fleet.central.put(key, b"x", congestion_control=zenoh.CongestionControl.BLOCK)
        fence(session)
    return seen.take()


@pytest.mark.parametrize(
    ("name", "expression", "key", "allowed"),
    dict.fromkeys([*HEARD, *((name, key, key, allowed) for name, key, allowed in cases(HEARS, MESSAGES))]),
)
def test_what_it_hears(fleet: Fleet, name: str, expression: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    found = heard(fleet, name, expression, key)
    able, sentinel = sentinel_of(name, HEARS, MESSAGES)
    assert heard(fleet, able, sentinel, sentinel) == [sentinel]
    assert found == ([key] if allowed else [])


@pytest.mark.parametrize(
    ("name", "key", "allowed"),
    [
        ("r1", "fleet/r1/front/classes", True),
        ("r1", "fleet/r2/front/classes", False),
        ("wall", "fleet/r2/front/classes", True),
        ("wall", "fleet/r2/front/detections", False),
        ("ann", "fleet/r2/front/detections", True),
        ("gpu1", "models/registry", True),
        ("stranger", "fleet/r2/front/classes", False),
    ],
)
def test_what_it_gets_of_what_is_kept(fleet: Fleet, name: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    able, sentinel = sentinel_of(name, HEARS, MESSAGES)
    with (
        keeping(fleet, key),
        keeping(fleet, sentinel),
        listening(fleet, name, key) as seen,
        listening(fleet, able, sentinel) as known,
    ):
        assert known.until(1) == [sentinel]
        fence(fleet.members[name])
        assert seen.until(int(allowed)) == ([key] if allowed else [])


@contextmanager
def keeping(fleet: Fleet, key: str) -> Iterator[None]:
    """Have the router's own session keep a message for those who come late."""
    kept: AdvancedPublisher = declare_advanced_publisher(
        fleet.central,
        key,
        cache=CacheConfig(5),
        publisher_detection=True,
        sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
    )
    kept.put(b"earlier")
    yield
    kept.undeclare()


@contextmanager
def listening(fleet: Fleet, name: str, key: str) -> Iterator[Seen]:
    """Have a member hear what is, and was, sent."""
    seen, history = Seen(), HistoryConfig(detect_late_publishers=True)
    subscriber = declare_advanced_subscriber(fleet.members[name], key, seen, history=history)
    yield seen
    subscriber.undeclare()


ASKED = [
    ("central2", "models/list", True),
    ("central2", "models/use", False),
    ("berlin", "fleet/r2/clock", False),
    ("berlin", "warehouses/lyon/world/main/objects", False),
    ("central2", "warehouses/berlin/world/main/objects", True),
    ("r1", "fleet/r2/clock", False),
    ("r1", "fleet/*/clock", False),
    ("r1", "services/monitor/inventory", False),
    ("r1", "services/detector/infer/gpu1-12-ab", False),
    ("r1", "world/main/objects", False),
    ("r1", "fleet/r2/service/reset", False),
    ("gpu1", "fleet/r2/clock", True),
    ("gpu1", "services/monitor/inventory", False),
    ("world1", "fleet/r2/clock", True),
    ("world1", "services/monitor/inventory", False),
    ("world1", "services/detector/infer/gpu1-12-ab", False),
    ("world1", "models/use", False),
    ("rack1", "fleet/r2/clock", True),
    ("rack1", "services/monitor/inventory", False),
    ("rack1", "services/detector/infer/gpu1-12-ab", False),
    ("rack1", "warehouses/berlin/world/main/objects", False),
    ("berlin", "services/monitor/inventory", False),
    ("berlin", "models/list", False),
    ("central2", "fleet/r2/service/reset", True),
    ("ann", "fleet/r2/service/reset", True),
    ("ann", "services/detector/infer/gpu1-12-ab", True),
    ("ann", "world/main/objects", True),
    ("wall", "services/monitor/inventory", False),
    ("wall", "services/collect", False),
    ("r1", "services/collect", False),
    ("gpu1", "services/collect", False),
    ("central2", "services/collect", True),
    ("wall", "world/main/objects", False),
    ("wall", "fleet/r2/service/reset", False),
    ("ann", "models/publish", True),
    ("ann", "models/use", True),
    ("gpu1", "models/piece", True),
    ("gpu1", "models/publish", False),
    ("gpu1", "models/use", False),
    ("r1", "models/piece", True),
    ("r1", "models/use", False),
    ("central2", "models/use", False),
    ("rack1", "models/piece", False),
    ("wall", "models/list", False),
    ("stranger", "services/monitor/inventory", False),
]


def answered(session: zenoh.Session, key: str) -> list[str]:
    """Return the keys of the answers to a session; all that were to come."""
    return [str(reply.ok.key_expr) if reply.ok else "none in time" for reply in session.get(key, timeout=PATIENCE_S)]


@pytest.mark.parametrize(("name", "key", "allowed"), with_all(ASKED, ASKS, MESSAGES))
def test_what_it_asks(fleet: Fleet, name: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    place = key.replace("*", "r2")
    with fleet.central.declare_queryable(place, lambda query: query.reply(place, b"secret")):
        assert answered(fleet.central, place) == [place]
        found = answered(fleet.members[name], key)
    able, sentinel = sentinel_of(name, ASKS, MESSAGES)
    with fleet.central.declare_queryable(sentinel, lambda query: query.reply(sentinel, b"known")):
        assert answered(fleet.members[able], sentinel) == [sentinel]
    assert found == ([place] if allowed else [])


WATCHED = [
    ("r1", "fleet/r1/**", "fleet/r1/front/color/alive", True),
    ("r1", "workers/**", "workers/detector/gpu1-12-ab/1/-/alive", True),
    ("r1", "fleet/r2/**", "fleet/r2/alive", False),
    ("r1", "fleet/*/alive", "fleet/r2/alive", False),
    ("r1", "**", "fleet/r2/alive", False),
    ("gpu1", "fleet/*/*/color/alive", "fleet/r2/front/color/alive", True),
    ("ann", "fleet/**", "fleet/r2/alive", True),
    ("ann", "fleet/*/@alive/*", "fleet/r2/@alive/front:color:alive", True),
    ("gpu1", "fleet/*/@alive/*", "fleet/r2/@alive/front:color:alive", True),
    ("r1", "fleet/r1/@alive/*", "fleet/r1/@alive/front:color:alive", True),
    ("r1", "fleet/*/@alive/*", "fleet/r2/@alive/front:color:alive", False),
    ("wall", "fleet/*/@alive/*", "fleet/r2/@alive/front:color:alive", False),
    ("wall", "fleet/*/*/classes/alive", "fleet/r2/front/classes/alive", True),
    ("wall", "fleet/*/alive", "fleet/r2/alive", False),
    ("wall", "**", "fleet/r2/alive", False),
    ("stranger", "**", "fleet/r2/alive", False),
]


def watched(fleet: Fleet, name: str, expression: str, key: str, kind: str) -> list[str]:
    """Return what a member sees of a token."""
    session, seen = fleet.members[name], Seen()
    with fleet.central.liveliness().declare_token(key):
        if kind == "subscription":
            with session.liveliness().declare_subscriber(expression, seen.at_once, history=True):
                fence(session)
                found = seen.take()
        else:
            began_s = time.monotonic()
            replies = session.liveliness().get(expression, timeout=PATIENCE_S)
            found = [str(reply.ok.key_expr) for reply in replies if reply.ok]
            assert time.monotonic() - began_s < PATIENCE_S  # it has no other sign of having ended unanswered
    fence(session)  # what is told of the token's end is not told to the next
    return found


@pytest.mark.parametrize(
    ("name", "expression", "key", "allowed"),
    dict.fromkeys([*WATCHED, *((name, key, key, allowed) for name, key, allowed in cases(WATCHES, TOKENS))]),
)
@pytest.mark.parametrize("kind", ["subscription", "query"])
def test_whose_presence_it_sees(  # noqa: PLR0917
    fleet: Fleet,
    name: str,
    expression: str,
    key: str,
    kind: str,
    allowed: bool,  # noqa: FBT001
) -> None:
    found = watched(fleet, name, expression, key, kind)
    able, sentinel = sentinel_of(name, WATCHES, TOKENS)
    assert watched(fleet, able, sentinel, sentinel, kind) == [sentinel]
    assert found == ([key] if allowed else [])


@pytest.mark.parametrize("name", MEMBERS)
def test_nobody_reads_a_routers_admin_space(fleet: Fleet, name: str) -> None:
    router = str(fleet.central.info.zid())
    assert any(router in key for key in answered(fleet.central, "@/**"))
    session = fleet.members[name]
    own = str(session.info.zid())
    assert [key for key in answered(session, "@/**") if own not in key] == []
