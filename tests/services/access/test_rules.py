"""A real router, real certificates: what each role may do under the rules, and that all else comes to nothing."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

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

from bus.session.config import session_config
from services.access.roles import ALL
from tests.services.access.links import QUIET_S, Seen, make_pki, member, router, settings_of

ANSWER_S = 3.0
BOUND = ("r1", "r3", "gpu1", "rack1", "world1", "central2", "ann", "wall", "stranger")


class Fleet:
    """A router and a session of each member."""

    def __init__(self, folder: Path, central: zenoh.Session, endpoint: str, members: dict[str, zenoh.Session]) -> None:
        self.folder = folder
        self.central = central
        self.endpoint = endpoint
        self.members = members


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    folder = tmp_path_factory.mktemp("access") / "pki"
    make_pki(folder)
    with router(folder) as (central, endpoint):
        members = {}
        opened = [member(folder, name, endpoint) for name in BOUND]
        try:
            for name, each in zip(BOUND, opened, strict=True):
                members[name] = each.__enter__()
            yield Fleet(folder, central, endpoint, members)
        finally:
            for session in members.values():
                session.close()


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
    subscribers = [fleet.central.declare_subscriber(expression, seen) for expression in ALL]
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


HEARD = [
    ("r1", "fleet/r1/actions", "fleet/r1/actions", True),
    ("r1", "fleet/r1/**", "fleet/r1/front/classes", True),
    ("r1", "fleet/r2/front/classes", "fleet/r2/front/classes", False),
    ("r1", "fleet/*/front/classes", "fleet/r2/front/classes", False),
    ("r1", "fleet/**", "fleet/r2/front/color", False),
    ("r1", "**", "fleet/r2/front/color", False),
    ("r1", "workers/**", "workers/detector/gpu1-12-ab/status", False),
    ("r1", "world/**", "world/main/changes", False),
    ("r3", "fleet/r3/**", "fleet/r3/actions", False),
    ("gpu1", "fleet/*/*/color", "fleet/r2/front/color", True),
    ("rack1", "fleet/*/*/depth", "fleet/r2/front/depth", True),
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


def matching(publisher: zenoh.Publisher) -> bool:
    status: Any = publisher.matching_status  # its stub says bool
    return bool(status.matching)


def until_matching(publisher: zenoh.Publisher, *, expected: bool) -> None:
    end = time.monotonic() + (10 if expected else QUIET_S)
    while not matching(publisher) and time.monotonic() < end:
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("name", "key", "allowed"),
    [
        ("r1", "fleet/r1/front/classes", True),
        ("r1", "fleet/r2/front/classes", False),
        ("wall", "fleet/r2/front/classes", True),
        ("wall", "fleet/r2/front/detections", False),
        ("ann", "fleet/r2/front/detections", True),
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
    ("r1", "fleet/r2/clock", False),
    ("r1", "fleet/*/clock", False),
    ("r1", "services/monitor/inventory", False),
    ("r1", "services/detector/infer/gpu1-12-ab", False),
    ("r1", "world/main/objects", False),
    ("r1", "fleet/r2/service/reset", False),
    ("gpu1", "fleet/r2/clock", True),
    ("gpu1", "services/monitor/inventory", False),
    ("world1", "fleet/r2/clock", True),
    ("central2", "fleet/r2/service/reset", True),
    ("ann", "fleet/r2/service/reset", True),
    ("ann", "services/detector/infer/gpu1-12-ab", True),
    ("ann", "world/main/objects", True),
    ("wall", "services/monitor/inventory", False),
    ("wall", "world/main/objects", False),
    ("wall", "fleet/r2/service/reset", False),
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


ANSWERED = [
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
    ("wall", "world/main/objects", False),
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


SHOWN = [
    ("r1", "fleet/r1/alive", True),
    ("r1", "fleet/r1/front/color/alive", True),
    ("r1", "workers/distance/r1-12-ab/1/r1/alive", True),
    ("r1", "workers/distance/r1-12-ab/serves/r1/front", True),
    ("r1", "fleet/r2/alive", False),
    ("r1", "fleet/r2/front/color/wanted/here/x", False),
    ("r1", "workers/distance/r1-12-ab/1000/-/alive", False),
    ("r1", "workers/distance/r1-12-ab/1/r2/alive", False),
    ("r1", "workers/detector/gpu1-12-ab/serves/r2/front", False),
    ("r3", "fleet/r3/alive", False),
    ("gpu1", "workers/detector/gpu1-12-ab/1/-/alive", True),
    ("gpu1", "fleet/r1/front/color/wanted/here/x", True),
    ("gpu1", "workers/detector/gpu2-12-ab/1/-/alive", False),
    ("gpu1", "workers/distance/gpu1-12-ab/1/-/alive", False),
    ("gpu1", "fleet/r1/alive", False),
    ("gpu1", "fleet/r1/front/color/alive", False),
    ("world1", "workers/worldmodel/world1-12-ab/1/-/alive", True),
    ("world1", "fleet/r1/alive", False),
    ("central2", "fleet/r1/front/color/wanted/here/x", True),
    ("central2", "fleet/r1/alive", False),
    ("ann", "fleet/r1/alive", False),
    ("wall", "fleet/r1/front/color/wanted/here/x", False),
    ("wall", "workers/detector/wall-12-ab/1/-/alive", False),
    ("stranger", "fleet/stranger/alive", False),
]


@pytest.mark.parametrize(("name", "key", "allowed"), SHOWN)
def test_what_presence_it_shows(fleet: Fleet, name: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    seen = Seen()
    watching = fleet.central.liveliness().declare_subscriber("**", seen)
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


WATCHED = [
    ("r1", "fleet/r1/**", "fleet/r1/front/color/alive", True),
    ("r1", "workers/**", "workers/detector/gpu1-12-ab/1/-/alive", True),
    ("r1", "fleet/r2/**", "fleet/r2/alive", False),
    ("r1", "fleet/*/alive", "fleet/r2/alive", False),
    ("r1", "**", "fleet/r2/alive", False),
    ("gpu1", "fleet/*/*/color/alive", "fleet/r2/front/color/alive", True),
    ("ann", "fleet/**", "fleet/r2/alive", True),
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


@pytest.mark.parametrize("name", BOUND)
def test_nobody_reads_a_routers_admin_space(fleet: Fleet, name: str) -> None:
    replies = fleet.members[name].get("@/**", timeout=ANSWER_S)
    own = str(fleet.members[name].info.zid())
    assert [str(reply.ok.key_expr) for reply in replies if reply.ok and own not in str(reply.ok.key_expr)] == []


def test_a_robot_that_is_a_router_itself_is_told_of_demand_and_not_of_other_robots(fleet: Fleet) -> None:
    with member(fleet.folder, "r2", fleet.endpoint, mode="router") as gateway:
        publisher = gateway.declare_publisher("fleet/r2/front/color")
        others = gateway.liveliness().declare_subscriber("fleet/**", seen := Seen(), history=True)
        subscriber = fleet.members["gpu1"].declare_subscriber("fleet/*/*/color", heard := Seen())
        until_matching(publisher, expected=True)
        assert heard.after(lambda: publisher.put(b"x"), expected=1) == ["fleet/r2/front/color"]
        token = fleet.central.liveliness().declare_token("fleet/r1/alive")
        assert seen.after(lambda: None, expected=0) == []
        subscriber.undeclare()
        others.undeclare()
        publisher.undeclare()
        token.undeclare()


def test_a_certificate_of_another_authority_opens_no_link(fleet: Fleet, tmp_path: Path) -> None:
    make_pki(tmp_path / "other")
    settings = settings_of(tmp_path / "other", "r1", connect=[fleet.endpoint])
    with pytest.raises(zenoh.ZError):
        zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(settings))))


def test_a_link_ends_with_its_certificate(tmp_path: Path) -> None:
    authority = make_pki(tmp_path / "pki")
    authority.renew("r1", 5 / 86_400)
    with router(tmp_path / "pki") as (_, endpoint), member(tmp_path / "pki", "r1", endpoint) as session:
        assert session.info.links()
        end = time.monotonic() + 20
        while session.info.links():
            assert time.monotonic() < end
            time.sleep(0.1)
