"""Two routers with the same rules, linked to each other: within these, members of one hear those of the other."""

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import zenoh

from tests.services.access.links import QUIET_S, Seen, make_pki, member, router, until_matching

FLEET = """
robots: [r1, r2]
roles:
  central: [monitor, ROLE]
  second: ROLE
  ann: operator
  wall: observer
"""


@pytest.fixture(scope="module")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("routers") / "pki"
    make_pki(folder)
    return folder


@pytest.fixture(params=["router", "observer"])
def members(request: pytest.FixtureRequest, pki: Path) -> Iterator[tuple[bool, dict[str, zenoh.Session]]]:
    """Yield whether the routers have the role, a robot at the second one, and others at the first."""
    fleet = FLEET.replace("ROLE", request.param)
    with (
        router(pki, fleet=fleet) as (central, first),
        router(pki, fleet=fleet, name="second", connect=[first]) as (other, second),
        member(pki, "r1", second) as robot,
        member(pki, "ann", first) as ann,
        member(pki, "wall", first) as wall,
    ):
        end = time.monotonic() + 10
        while not (central.info.routers_zid() and other.info.routers_zid()):
            assert time.monotonic() < end
            time.sleep(0.02)
        time.sleep(QUIET_S)  # each learns whom the other has
        yield request.param == "router", {"r1": robot, "ann": ann, "wall": wall}


def test_a_robot_at_one_is_heard_at_the_other_by_those_who_may(
    members: tuple[bool, dict[str, zenoh.Session]],
) -> None:
    are_routers, of = members
    for name, key, allowed in (
        ("ann", "fleet/r1/c1/classes", True),
        ("ann", "fleet/r1/c2/color", True),
        ("wall", "fleet/r1/c3/classes", True),
        ("wall", "fleet/r1/c4/color", False),
        ("ann", "fleet/r2/c5/classes", False),  # the robot speaks for another one
    ):
        seen, known = Seen(), Seen()
        sent_last = f"fleet/r1/{key.split('/')[2]}-last/classes"  # which they may hear; nobody heard it before
        with (
            of["r1"].declare_publisher(sent_last) as last,
            of[name].declare_subscriber(key, seen),
            of[name].declare_subscriber(sent_last, known),
        ):
            until_matching(last, expected=are_routers)
            of["r1"].put(key, b"x")
            if are_routers:
                last.put(b"x")
                assert known.until(1) == [sent_last]
            else:
                assert known.after(partial(last.put, b"x"), expected=0) == []
            assert seen.until(int(are_routers and allowed)) == [key] * (are_routers and allowed), (name, key)


def test_its_presence_is_too(members: tuple[bool, dict[str, zenoh.Session]]) -> None:
    are_routers, of = members
    seen = Seen()
    subscriber = (
        of["ann"].liveliness().declare_subscriber("fleet/*/alive", seen, history=True)
    )  # a token may overtake it
    tokens: list[zenoh.LivelinessToken] = []

    def show() -> None:
        tokens.extend(of["r1"].liveliness().declare_token(f"fleet/{robot}/alive") for robot in ("r2", "r1"))

    if are_routers:
        show()
        assert seen.until(1) == ["fleet/r1/alive"]
    else:
        assert seen.after(show, expected=0) == []
    subscriber.undeclare()


def test_and_what_it_answers(members: tuple[bool, dict[str, zenoh.Session]]) -> None:
    are_routers, of = members
    with of["r1"].declare_queryable("fleet/r1/call", lambda query: query.reply("fleet/r1/call", b"here")):
        answers = [reply.ok is not None for _ in range(20) for reply in of["ann"].get("fleet/r1/call", timeout=0.5)]
    assert any(answers) == are_routers
