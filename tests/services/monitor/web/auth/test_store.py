import logging
from pathlib import Path

import pytest

from services.monitor.history.engine import engine_of
from services.monitor.history.state import HistoryError
from services.monitor.history.tables import logins, users
from services.monitor.web.auth.store import UserStore
from services.monitor.web.auth.users import Kind, Role, User
from tests.services.monitor.web.auth.test_logins import access_to
from tests.services.monitor.web.serving import PASSWORD, access_in, users_in


async def newer(folder: Path) -> None:
    """Write what a newer version might: a role and a kind of log-in that are not known here."""
    await UserStore(users_in(folder)).users()
    engine = engine_of(users_in(folder))
    carl = {"name": "carl", "role": "auditor", "password": "x", "changed_ns": 1}
    async with engine.begin() as connection:
        await connection.execute(users.insert().values(carl))
        for digest in ("a", "b"):
            row = {"digest": digest, "user": "viewer", "kind": "passkey", "user_ns": 1, "until_ns": 2**62}
            await connection.execute(logins.insert().values(**row))
    await engine.dispose()


async def test_rows_of_a_newer_version_are_left_out_with_one_warning_each(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    await access_in(tmp_path)
    await newer(tmp_path)
    access = access_to(tmp_path)
    with caplog.at_level(logging.WARNING):
        await access.look()
        await access.look()
    assert sorted(caplog.messages) == [
        "left out: log-ins of the kind 'passkey', which this version does not know",
        "left out: the user 'carl', whose role 'auditor' this version does not know",
    ]
    assert access.problem == ""
    session = await access.log_in("viewer", PASSWORD, "a")
    assert access.visitor(session, Kind.SESSION) is not None


async def test_who_is_removed_is_not_left_out_any_more(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    store = UserStore(users_in(tmp_path))
    await newer(tmp_path)
    assert (await store.users(), store.left_out) == ([], {"carl"})
    await store.remove("carl")
    assert (await store.users(), store.left_out) == ([], set())
    await store.users()
    assert caplog.text.count("the user 'carl'") == 1


async def test_a_user_who_is_left_out_is_there(tmp_path: Path) -> None:
    await newer(tmp_path)
    access = access_to(tmp_path)
    await access.look()
    assert (access.needs_setup, access.invitation) == (False, "")


async def test_a_file_is_made_once_and_waited_for_when_it_is_gone(tmp_path: Path) -> None:
    store, file = UserStore(users_in(tmp_path)), tmp_path / "users.db"
    assert await store.users() == []
    file.unlink()
    for _ in range(2):
        with pytest.raises(HistoryError, match=r"users\.db: it does not exist"):
            await store.add(User("ann", Role.VIEWER, "x", 1), first=True)
    assert not file.exists()
    assert await UserStore(users_in(tmp_path)).add(User("bob", Role.VIEWER, "x", 1))
    assert [user.name for user in await store.users()] == ["bob"]
