"""Which actions a robot does: those of now, each once, whoever sends them."""

import msgspec
import pytest

from gateway.to_ros.actions import (
    AHEAD,
    EARLIER,
    MANY,
    MOST_AGE_NS,
    MOST_AHEAD_NS,
    MOST_REMEMBERED,
    NS,
    OLD,
    FreshActions,
)
from gateway.to_ros.outputs import actions_return
from gateway.to_ros.stream import NotNowError
from schemas import codec
from schemas.alerts import Action
from schemas.errors import SchemaError
from schemas.keys import RobotStreamKey
from tests.schemas.results import action

KEY = RobotStreamKey("r1", "actions")
DAY_NS = 86_400 * NS


class Clocks:
    """A robot's clock, which may be set, and one that goes on."""

    def __init__(self) -> None:
        self.wall_ns = 2_000_000 * NS
        self.steady_ns = 7 * NS

    def wait(self, seconds: float) -> None:
        self.wall_ns += round(seconds * NS)
        self.steady_ns += round(seconds * NS)


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


def fresh(clocks: Clocks) -> FreshActions:
    return FreshActions(KEY, lambda: clocks.wall_ns, lambda: clocks.steady_ns)


def sent(clocks: Clocks, id_: str = "1", *, ago_s: float = 0) -> Action:
    return msgspec.structs.replace(action(id_=id_), sent_ns=clocks.wall_ns - round(ago_s * NS))


def done(actions: FreshActions, asked: Action) -> bool:
    if new := actions.is_new(asked):
        actions.remember(asked)
    return new


def test_an_action_of_now_is_done_once(clocks: Clocks) -> None:
    actions = fresh(clocks)
    assert [done(actions, sent(clocks, id_)) for id_ in ("1", "1", "2")] == [True, False, True]


@pytest.mark.parametrize("sent_ns", [0, 1, 2**63 - 1])
def test_one_without_a_time_that_can_be_is_refused(clocks: Clocks, sent_ns: int) -> None:
    clocks.wait(100)
    with pytest.raises(NotNowError, match="clocks"):
        fresh(clocks).is_new(msgspec.structs.replace(action(), sent_ns=sent_ns))


def test_one_that_is_sent_again_is_refused_for_ever(clocks: Clocks) -> None:
    actions = fresh(clocks)
    clocks.wait(1)
    first = sent(clocks)
    assert done(actions, first)
    others = [sent(clocks, f"other {number}") for number in range(2_000)]
    assert all(done(actions, other) for other in others)
    for _ in range(200):
        clocks.wait(0.1)
        assert not actions.is_new(first)
    clocks.wait(MOST_AGE_NS / NS)
    with pytest.raises(NotNowError, match=OLD):
        actions.is_new(first)


def test_one_from_before_a_restart_is_refused(clocks: Clocks) -> None:
    clocks.wait(100)
    earlier = sent(clocks)
    clocks.wait(1)
    actions = fresh(clocks)
    with pytest.raises(NotNowError, match=EARLIER):
        actions.is_new(earlier)
    assert done(actions, sent(clocks, "2"))


def test_a_robot_whose_clock_is_set_back_still_does_what_is_sent_then(clocks: Clocks) -> None:
    actions = fresh(clocks)
    clocks.wait(50)
    clocks.wall_ns -= DAY_NS
    assert done(actions, sent(clocks))


@pytest.mark.parametrize(("ago_s", "reason"), [(MOST_AGE_NS / NS + 1, OLD), (-MOST_AHEAD_NS / NS - 1, AHEAD)])
def test_one_of_another_time_is_refused_and_says_why(clocks: Clocks, ago_s: float, reason: str) -> None:
    actions = fresh(clocks)
    clocks.wait(100)
    with pytest.raises(NotNowError, match=reason):
        actions.is_new(sent(clocks, ago_s=ago_s))


@pytest.mark.parametrize("apart_ns", [-DAY_NS, DAY_NS])
def test_clocks_that_are_apart_do_not_matter_where_they_are_measured(clocks: Clocks, apart_ns: int) -> None:
    actions = fresh(clocks)
    clocks.wait(100)
    asked = msgspec.structs.replace(action(), sent_ns=clocks.wall_ns + apart_ns)
    with pytest.raises(NotNowError):
        actions.is_new(asked)
    assert done(actions, msgspec.structs.replace(asked, robot_ns=clocks.wall_ns))


def test_so_many_at_once_are_no_longer_done(clocks: Clocks) -> None:
    actions = fresh(clocks)
    for number in range(MOST_REMEMBERED):
        assert done(actions, sent(clocks, str(number)))
    with pytest.raises(NotNowError, match=MANY):
        actions.is_new(sent(clocks, "one more"))
    assert not actions.is_new(sent(clocks, "0"))
    clocks.wait((MOST_AGE_NS + MOST_AHEAD_NS) / NS + 1)
    assert done(actions, sent(clocks, "later"))


def test_one_for_another_robot_is_malformed(clocks: Clocks) -> None:
    with pytest.raises(SchemaError, match="it is for r2"):
        fresh(clocks).is_new(action(robot="r2"))


def test_a_refusal_is_counted_by_its_reason() -> None:
    stream = actions_return("r1", {"pick_up": "/planner/pick_up"}, lambda topic: topic)
    old = msgspec.structs.replace(action(), sent_ns=0)
    assert stream.receive(codec.encode(old), codec.encoding(Action), 0) is None
    assert stream.status(wanted=True, subscribers=1, slow=0).dropped == {OLD: 1}
