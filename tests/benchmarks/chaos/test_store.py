"""What is read of a history, and of a journal that workers write meanwhile."""

from pathlib import Path

from benchmarks.chaos.accounts import Published
from benchmarks.chaos.resources import Use, growth
from benchmarks.chaos.store import Journal, Store
from schemas.alerts import Alert, AlertState, Severity
from services.monitor.history.store import Store as History
from tests.services.monitor.history.test_store import interval
from tests.services.monitor.inventory.seeing import FRONT


def alert(name: str, about: str, state: AlertState) -> Alert:
    return Alert(
        id=name,
        rule="in view",
        severity=Severity.INFO,
        state=state,
        robot="r1",
        name=about,
        text="",
        raised_ns=1,
        changed_ns=1,
    )


async def test_rows_of_class_lists_and_alerts_are_those_of_the_history(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.db'}"
    history = await History.open(url)
    try:
        once, twice = interval(1, 2, name="list-w1-1"), interval(1, 2, name="list-w1-2")
        again = interval(5, 6, name="list-w1-2")
        alerts = [
            alert("a1", "pallet", AlertState.RAISED),
            alert("a2", "pallet", AlertState.RESOLVED),
            alert("a3", "box", AlertState.RAISED),
        ]
        await history.write([once, twice, again], alerts, 7)
    finally:
        await history.close()
    assert FRONT.robot == "r1"
    store = Store(url)
    assert await store.rows(["list-w1-1", "list-w1-2", "list-w1-3"]) == {"list-w1-1": 1, "list-w1-2": 2}
    assert await store.alerts() == {"a1": True, "a2": False}


def test_a_journal_is_read_as_far_as_its_lines_are_whole(tmp_path: Path) -> None:
    file = tmp_path / "journal"
    journal = Journal(file)
    assert list(journal.lists()) == []
    lists = [Published(f"list-w1-{number}", number, pallet=bool(number)) for number in range(2)]
    file.write_text(lists[0].line() + lists[1].line()[:-3], encoding="ascii")
    assert list(journal.lists()) == lists[:1]
    file.write_text(lists[0].line() + lists[1].line(), encoding="ascii")
    assert list(journal.lists()) == lists


def test_growth_is_of_processes_that_are_still_the_same() -> None:
    before = {"router": Use(1, 10 << 20, 5), "monitor": Use(2, 10 << 20, 5), "cloud": Use(3, 10 << 20, 5)}
    after = {"router": Use(1, 12 << 20, 6), "monitor": Use(9, 99 << 20, 99)}
    assert growth(before, after) == {"router": (2.0, 1)}
