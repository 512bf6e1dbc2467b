"""A real router, real certificates: what each role may hear, ask and watch; all else stays secret."""

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

from tests.services.access.links import (
    ANSWER_S,
    BOUND,
    Fleet,
    Seen,
    until_matching,
)

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


@pytest.mark.parametrize(("name", "expression", "key", "allowed"), HEARD)
def test_what_it_hears(fleet: Fleet, name: str, expression: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    seen = Seen()
    publisher = fleet.central.declare_publisher(key)
    subscriber = fleet.members[name].declare_subscriber(expression, seen)
    try:
        until_matching(publisher, expected=allowed)
        assert seen.after(lambda: publisher.put(b"x"), expected=int(allowed)) == ([key] if allowed else [])
    finally:
        subscriber.undeclare()
        publisher.undeclare()


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
    kept: AdvancedPublisher = declare_advanced_publisher(
        fleet.central,
        key,
        cache=CacheConfig(5),
        publisher_detection=True,
        sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
    )
    kept.put(b"earlier")
    seen = Seen()

    def listen() -> None:
        listening.append(
            declare_advanced_subscriber(
                fleet.members[name], key, seen, history=HistoryConfig(detect_late_publishers=True)
            )
        )

    listening: list[object] = []
    try:
        assert seen.after(listen, expected=int(allowed)) == ([key] if allowed else [])
    finally:
        for each in listening:
            each.undeclare()  # type: ignore[attr-defined]
        kept.undeclare()


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


@pytest.mark.parametrize(("name", "key", "allowed"), ASKED)
def test_what_it_asks(fleet: Fleet, name: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    place = key.replace("*", "r2")
    queryable = fleet.central.declare_queryable(place, lambda query: query.reply(place, b"secret"))
    try:
        replies = [str(reply.ok.key_expr) for reply in fleet.members[name].get(key, timeout=ANSWER_S) if reply.ok]
        assert replies == ([place] if allowed else [])
    finally:
        queryable.undeclare()


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


@pytest.mark.parametrize(("name", "expression", "key", "allowed"), WATCHED)
@pytest.mark.parametrize("kind", ["subscription", "query"])
def test_whose_presence_it_sees(  # noqa: PLR0917
    fleet: Fleet,
    name: str,
    expression: str,
    key: str,
    kind: str,
    allowed: bool,  # noqa: FBT001
) -> None:
    token = fleet.central.liveliness().declare_token(key)
    seen = Seen()
    watching: list[zenoh.Subscriber[None]] = []
    presence = fleet.members[name].liveliness()
    try:
        if kind == "subscription":
            found = seen.after(
                lambda: watching.append(presence.declare_subscriber(expression, seen, history=True)),
                expected=int(allowed),
            )
        else:
            found = [str(reply.ok.key_expr) for reply in presence.get(expression, timeout=ANSWER_S) if reply.ok]
        assert found == ([key] if allowed else [])
    finally:
        for each in watching:
            each.undeclare()
        token.undeclare()
        fleet.wait_until_nobody_is_present()


@pytest.mark.parametrize("name", BOUND)
def test_nobody_reads_a_routers_admin_space(fleet: Fleet, name: str) -> None:
    replies = fleet.members[name].get("@/**", timeout=ANSWER_S)
    own = str(fleet.members[name].info.zid())
    assert [str(reply.ok.key_expr) for reply in replies if reply.ok and own not in str(reply.ok.key_expr)] == []
