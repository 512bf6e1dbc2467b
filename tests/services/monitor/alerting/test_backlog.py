import pytest

from schemas.alerts import AlertState
from services.monitor.alerting import backlog as module
from services.monitor.alerting.backlog import Backlog
from tests.schemas.results import alert


def ids(backlog: Backlog) -> list[str]:
    return [each.id for each in backlog.first(len(backlog))]


def test_of_too_many_a_tenth_is_dropped_at_once_those_that_are_over_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_WAITING", 20)
    backlog = Backlog()
    over = {"a7": AlertState.RESOLVED}
    some = [alert(id_=f"a{number}", state=over.get(f"a{number}", AlertState.RAISED)) for number in range(22)]
    assert [backlog.put(each) for each in some] == [*[0] * 20, 3, 0]
    assert ids(backlog) == [f"a{number}" for number in range(22) if number not in {0, 1, 7}]


def test_where_much_waits_an_alert_that_changes_again_and_again_drops_no_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "MAX_WAITING", 20)
    backlog = Backlog()
    for number in range(19):
        backlog.put(alert(id_=f"a{number}"))
    assert [backlog.put(alert(id_="again", changed_ns=changed_ns)) for changed_ns in range(10, 60)] == [0] * 50
    assert len(backlog) == 20
    assert not backlog.is_folded, "and it goes on one by one"


def test_one_that_fails_alone_waits_behind_the_others_and_goes_with_none_of_them() -> None:
    backlog = Backlog()
    bad, *others = [alert(id_=f"a{number}") for number in range(4)]
    for each in (bad, *others):
        backlog.put(each)
    assert backlog.put_off(bad) == 1
    assert backlog.put_off(bad) == 0, "nothing was done in between"
    assert ids(backlog) == ["a1", "a2", "a3", "a0"]
    assert [each.id for each in backlog.first(1)] == ["a1"]
    backlog.done(others[:1])
    assert backlog.put_off(bad) == 2
    assert ids(backlog) == ["a2", "a3"]
    backlog.done(others)
    assert ids(backlog) == ["a0"]
