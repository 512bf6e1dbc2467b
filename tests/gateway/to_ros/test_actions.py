"""Which actions a robot does: those of now, each once, whoever sends them."""

import errno
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest

from gateway.to_ros import done_actions
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
from gateway.to_ros.done_actions import DoneActions, state_folder
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


def fresh(clocks: Clocks, state: Path | None = None) -> FreshActions:
    return FreshActions(KEY, DoneActions(state), lambda: clocks.wall_ns, lambda: clocks.steady_ns)


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


@pytest.mark.parametrize("ahead_s", [0.5, 3, MOST_AHEAD_NS / NS])
@pytest.mark.parametrize("set_back_s", [0, 2.5, 3_600])
def test_one_that_was_done_before_a_restart_is_not_done_again_whatever_the_clocks(
    clocks: Clocks, tmp_path: Path, ahead_s: float, set_back_s: float
) -> None:
    asked = sent(clocks, ago_s=-ahead_s)
    assert done(fresh(clocks, tmp_path), asked)
    clocks.wall_ns -= round(set_back_s * NS)
    actions = fresh(clocks, tmp_path)
    for _ in range(50):
        clocks.wait(1)
        with suppress(NotNowError):
            assert not actions.is_new(asked)
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
    stream = actions_return("r1", {"pick_up": "/planner/pick_up"}, lambda topic: topic, DoneActions(None))
    old = msgspec.structs.replace(action(), sent_ns=0)
    assert stream.receive(codec.encode(old), codec.encoding(Action), 0) is None
    assert stream.status(wanted=True, subscribers=1, slow=0).dropped == {OLD: 1}


def test_what_was_done_is_known_to_the_next_process_and_the_latest_at_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(done_actions, "MOST", 3)
    for number in range(20):
        DoneActions(tmp_path, "r1").add(f"pick \n {number}")
    known = DoneActions(tmp_path, "r1")
    assert [number for number in range(20) if f"pick \n {number}" in known] == [17, 18, 19]
    (file,) = tmp_path.iterdir()
    assert len(file.read_text(encoding="utf-8").splitlines()) <= 6
    assert "pick \n 19" not in DoneActions(tmp_path, "r2")


@pytest.mark.parametrize("spoilt", [b'"3', b'"3\n', b'"\xff\n', b"\n"])
def test_a_line_that_was_half_written_costs_no_other(tmp_path: Path, spoilt: bytes) -> None:
    DoneActions(tmp_path, "r1").add("1")
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes() + spoilt + b'"2"\n' * spoilt.endswith(b"\n"))
    DoneActions(tmp_path, "r1").add("4")
    DoneActions(tmp_path, "r1").add("5")
    known = DoneActions(tmp_path, "r1")
    assert [each in known for each in ("1", "2", "4", "5")] == [True, spoilt.endswith(b"\n"), True, True]


def test_a_disk_that_is_full_for_a_while_costs_no_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    actions = DoneActions(tmp_path, "r1")
    actions.add("1")
    (file,) = tmp_path.iterdir()

    def fill(*_: object, **__: object) -> None:
        with open(file, "ab") as torn:  # noqa: PTH123 - Path's is what fails
            torn.write(b'"2')
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(Path, "open", fill)
        actions.add("2")
    actions.add("3")
    assert [each in DoneActions(tmp_path, "r1") for each in ("1", "2", "3")] == [True, True, True]


@pytest.mark.parametrize("folder", ["gone", "x" * 300])
def test_a_folder_that_cannot_be_used_stops_no_action(
    clocks: Clocks, tmp_path: Path, caplog: pytest.LogCaptureFixture, folder: str
) -> None:
    actions = fresh(clocks, tmp_path / folder)
    assert [done(actions, sent(clocks)), done(actions, sent(clocks))] == [True, False]
    assert "will not be known after a restart: " in caplog.text


def test_the_folder_is_the_first_that_systemd_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert state_folder() is None
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/one:/var/lib/two")
    assert state_folder() == Path("/var/lib/one")
