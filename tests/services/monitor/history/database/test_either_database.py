"""What else is in the history's database, and who else reads it: on SQLite and on PostgreSQL alike."""

import asyncio
import csv
from io import StringIO
from pathlib import Path

import pytest

from schemas.alerts import AlertState
from services.monitor.history.archive import Archive
from services.monitor.history.export import run as export
from services.monitor.history.settings import ExportSettings
from services.monitor.history.state import Act
from services.monitor.rules.command import run as try_rules
from services.monitor.settings import RulesSettings
from services.monitor.web.auth.logins import Access, AccessError
from services.monitor.web.auth.store import UserStore
from services.monitor.web.auth.users import Kind, Role, User
from tests.schemas.results import alert
from tests.services.monitor.history.test_store import interval, opened
from tests.services.monitor.inventory.seeing import S
from tests.services.monitor.web.serving import PASSWORD


def monitor(url: str) -> Access:
    return Access(UserStore(url), 1, "http://monitor.test")


async def test_monitors_that_share_a_database_share_their_users_and_sessions(url: str) -> None:
    one, other = monitor(url), monitor(url)
    await one.look()
    await other.look()
    session = await one.set_up(one.invitation.split("=")[1], "ann", PASSWORD, "a")
    with pytest.raises(AccessError, match="made already"):
        await other.set_up(other.invitation.split("=")[1], "bob", PASSWORD, "a")
    await one.look()
    await other.look()
    visitor = other.visitor(session, Kind.SESSION)
    assert visitor is not None
    assert (visitor.name, visitor.role) == ("ann", Role.OPERATOR)
    other.log_out(session)
    await other.look()
    await one.look()
    assert one.visitor(session, Kind.SESSION) is None
    again = await other.log_in("ann", PASSWORD, "a")
    await other.look()
    assert await UserStore(url).remove("ann")
    await other.look()
    assert other.visitor(again, Kind.SESSION) is None


async def test_of_several_who_would_be_first_at_once_one_is(url: str) -> None:
    stores = [UserStore(url) for _ in range(8)]
    await stores[0].users()
    people = [User(f"user{number}", Role.OPERATOR, "x", 1) for number in range(len(stores))]
    added = await asyncio.gather(*(store.add(user, first=True) for store, user in zip(stores, people, strict=True)))
    assert await stores[0].users() == [user for user, was_first in zip(people, added, strict=True) if was_first]
    assert sum(added) == 1


async def test_history_is_exported_read_and_has_rules_tried_against_it(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with opened(url) as store:
        seen = [interval(1, 2), interval(5, 6, name='"bo,x"\n箱')]
        await store.write(seen, [alert()], 9 * S, [Act("a1", AlertState.ACKNOWLEDGED, "ann", 7)])
    await export(ExportSettings(task="export", history=url, to=tmp_path / "seen.csv"))
    rows = list(csv.DictReader(StringIO((tmp_path / "seen.csv").read_text(encoding="utf-8"))))
    assert [(row["class"], row["closest_m"]) for row in rows] == [("box", "1.25"), ('"bo,x"\n箱', "1.25")]
    rules = tmp_path / "rules.yaml"
    rules.write_text("rules: [{name: many, when: over, class: box, count: 1}]", encoding="utf-8")
    await try_rules(RulesSettings(task="test", file=rules, history=url))
    assert "1 rules, 2 intervals, 1 alerts" in capsys.readouterr().out
    (act,) = await Archive(url).acts(["a1"])
    assert (act.who, act.state) == ("ann", AlertState.ACKNOWLEDGED)
