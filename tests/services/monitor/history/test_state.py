"""Operators' actions that are remembered."""

from schemas.alerts import AlertState
from services.monitor.history.state import MAX_ACTS, MAX_ALERTS, Act, Acts


def act(alert: str, at_ns: int) -> Act:
    return Act(alert, AlertState.ACKNOWLEDGED, "ann", at_ns)


def test_each_is_remembered_once_in_order() -> None:
    acts = Acts()
    acts.take([act("a", 1), act("b", 2), act("a", 3), act("a", 1)])
    assert acts.of("a") == (act("a", 1), act("a", 3))
    assert acts.of("c") == ()


def test_so_many_are_remembered_and_no_more() -> None:
    acts = Acts()
    acts.take(act("a", number) for number in range(MAX_ACTS + 1))
    assert [each.at_ns for each in acts.of("a")][:1] == [1]
    acts.take(act(str(number), 0) for number in range(MAX_ALERTS))
    assert acts.of("a") == ()
    assert acts.of("0")
