from schemas.clock import ClockReading
from services.monitor.robot_clocks import MAX_UNCERTAINTY_NS, PERIOD_S, REMEMBERED_S, Clocks

NOW_NS = 1_700_000_000_000_000_000
AHEAD_NS = 5_000_000_000


def reading(*, at_ns: int = NOW_NS, ahead_ns: int = AHEAD_NS, clock_id: str = "theirs") -> ClockReading:
    theirs_ns = at_ns + ahead_ns
    return ClockReading(robot="r1", boot_id="b", clock_id=clock_id, received_ns=theirs_ns, sent_ns=theirs_ns)


def measured(*, way_ns: int = 1_000) -> Clocks:
    clocks = Clocks()
    clocks.due(["r1"], 0)
    clocks.take("r1", reading(), asked_ns=NOW_NS - way_ns, answered_ns=NOW_NS + way_ns)
    return clocks


def test_every_robot_is_due_at_once_and_then_now_and_again() -> None:
    clocks = Clocks()
    assert clocks.due(["r2", "r1"], 0) == ["r1", "r2"]
    assert clocks.due(["r1", "r2", "r3"], PERIOD_S - 0.1) == ["r3"]
    assert clocks.due(["r1", "r2", "r3"], PERIOD_S) == ["r1", "r2"]


def test_what_a_clock_shows_now() -> None:
    clocks = measured()
    assert clocks.theirs_ns("r1", "theirs", NOW_NS + 7) == NOW_NS + 7 + AHEAD_NS
    assert clocks.theirs_ns("r1", "another", NOW_NS) is None
    assert clocks.theirs_ns("r2", "theirs", NOW_NS) is None


def test_a_robot_that_went_is_remembered_while_what_its_clock_shows_is_known() -> None:
    clocks = measured()
    assert clocks.due(["r2"], REMEMBERED_S - 1) == ["r2"]
    long_ns = int(REMEMBERED_S * 1e9)
    assert clocks.theirs_ns("r1", "theirs", NOW_NS + long_ns // 2) == NOW_NS + long_ns // 2 + AHEAD_NS
    assert clocks.theirs_ns("r1", "theirs", NOW_NS + long_ns) is None
    clocks.due([], REMEMBERED_S)
    assert clocks.theirs_ns("r1", "theirs", NOW_NS) is None
    clocks.take("r1", reading(), asked_ns=NOW_NS, answered_ns=NOW_NS)
    assert clocks.theirs_ns("r1", "theirs", NOW_NS) is None
    assert clocks.due(["r1", "r2"], REMEMBERED_S + 1) == ["r1"]


def test_a_robot_on_another_machine_has_another_clock() -> None:
    clocks = measured()
    clocks.take("r1", reading(ahead_ns=9, clock_id="new"), asked_ns=NOW_NS - 50_000, answered_ns=NOW_NS + 50_000)
    assert clocks.theirs_ns("r1", "new", NOW_NS) == NOW_NS + 9
    assert clocks.theirs_ns("r1", "theirs", NOW_NS) is None


def test_an_offset_that_is_hardly_known_says_nothing() -> None:
    drift_ns = 20_000
    assert measured(way_ns=MAX_UNCERTAINTY_NS - drift_ns).theirs_ns("r1", "theirs", NOW_NS) is not None
    assert measured(way_ns=MAX_UNCERTAINTY_NS).theirs_ns("r1", "theirs", NOW_NS) is None
