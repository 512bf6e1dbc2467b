"""A real router, real certificates: what each role may send, answer and show; all else comes to nothing."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh

from tests.services.access.links import PATIENCE_S, Fleet, Seen, fence
from tests.services.access.rights import MESSAGES, SENDS, SHOWS, TOKENS, with_all
from tests.services.access.rights import sentinel as sentinel_of

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


@pytest.fixture(scope="module")
def heard(fleet: Fleet) -> Seen:
    """What the router's own session hears of the fleet."""
    seen = Seen()
    for part in ("fleet", "workers", "services", "world", "warehouses", "models", "elsewhere"):
        fleet.central.declare_subscriber(f"{part}/**", seen.at_once)
    return seen


@pytest.mark.parametrize(("name", "key", "allowed"), with_all(SENT, SENDS, MESSAGES))
@pytest.mark.parametrize("kind", ["put", "delete", "declared"])
def test_what_it_sends(  # noqa: PLR0917
    fleet: Fleet,
    heard: Seen,
    name: str,
    key: str,
    kind: str,
    allowed: bool,  # noqa: FBT001
) -> None:
    session = fleet.members[name]
    able, sentinel = sentinel_of(name, SENDS, MESSAGES)
    heard.take()
    match kind:
        case "put":
            session.put(key, b"x")
        case "delete":
            session.delete(key)
        case _:
            with session.declare_publisher(key) as publisher:
                fence(session)  # it knows whether somebody listens
                publisher.put(b"x")
    fence(session)
    fleet.members[able].put(sentinel, b"x")
    fence(fleet.members[able])
    assert heard.take() == [*([key] if allowed else []), sentinel]


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


def answers(fleet: Fleet, key: str, asked: str = "") -> list[str]:
    """Return the keys of the answers to the router's own session; none is late."""
    replies = fleet.central.get(asked or key, accept_replies=zenoh.ReplyKeyExpr.ANY, timeout=PATIENCE_S)
    return [str(reply.ok.key_expr) if reply.ok else "none in time" for reply in replies]


@contextmanager
def answering(fleet: Fleet, name: str, key: str, expression: str = "") -> Iterator[None]:
    """Have a member answer, as far as the router lets it."""
    session = fleet.members[name]
    with session.declare_queryable(expression or key, lambda query: query.reply(key, b"x")):
        fence(session)
        yield
    fence(session)


@pytest.mark.parametrize(("name", "key", "allowed"), with_all(ANSWERED, SENDS, MESSAGES))
def test_what_it_answers(fleet: Fleet, name: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    with answering(fleet, name, key):
        found = answers(fleet, key)
    able, sentinel = sentinel_of(name, SENDS, MESSAGES)
    with answering(fleet, able, sentinel):
        assert answers(fleet, sentinel) == [sentinel]
    assert found == ([key] if allowed else [])


@pytest.mark.parametrize(("name", "allowed"), [("r1", True), ("rack1", False), ("ann", False)])
def test_what_a_robot_keeps_is_had_from_one_queryable(fleet: Fleet, name: str, allowed: bool) -> None:  # noqa: FBT001
    key = "fleet/r1/front/info"
    with answering(fleet, name, key, "fleet/r1/**/@adv/pub/1/**"):
        assert answers(fleet, key, f"{key}/@adv/pub/1/2/_") == ([key] if allowed else [])


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


@pytest.mark.parametrize(("name", "key", "allowed"), with_all(SHOWN, SHOWS, TOKENS))
def test_what_presence_it_shows(fleet: Fleet, name: str, key: str, allowed: bool) -> None:  # noqa: FBT001
    seen = Seen()
    session, (able, sentinel) = fleet.members[name], sentinel_of(name, SHOWS, TOKENS)
    watching = [  # ** does not match the latter
        fleet.central.liveliness().declare_subscriber(expression, seen.at_once)
        for expression in ("**", "fleet/*/@alive/*")
    ]
    with session.liveliness().declare_token(key):
        fence(session)
        shown = seen.take()
        with fleet.members[able].liveliness().declare_token(sentinel):
            fence(fleet.members[able])
            assert seen.take() == [sentinel] or shown == [sentinel]
    for each in watching:
        each.undeclare()
    fence(session)
    fence(fleet.members[able])
    assert shown == ([key] if allowed else [])
