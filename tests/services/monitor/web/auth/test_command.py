"""`fleetsight users`."""

import asyncio
import io
import os
import pty
import signal
import sys
import termios
from pathlib import Path

import pytest
from pydantic import ValidationError

from services.monitor.history.state import HistoryError
from services.monitor.settings import UsersSettings
from services.monitor.web.auth.command import UsersError, read_password, run
from services.monitor.web.auth.store import UserStore
from services.monitor.web.auth.users import Kind, Role, User
from tests.services.monitor.history.database.test_engine import names
from tests.services.monitor.web.auth.test_logins import access_to
from tests.services.monitor.web.auth.test_store import newer
from tests.services.monitor.web.serving import users_in
from tests.waiting import PATIENCE_S, until

PASSWORD = "correct horse battery"  # noqa: S105 - nobody's


async def users(folder: Path, task: str, name: str = "", **given: object) -> None:
    history = f"sqlite:///{folder / 'users.db'}"
    await run(UsersSettings.model_validate({"task": task, "name": name, "history": history, **given}))


def says(monkeypatch: pytest.MonkeyPatch, password: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{password}\n"))


async def test_from_being_added_to_being_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    access = access_to(tmp_path)
    says(monkeypatch, PASSWORD)
    await users(tmp_path, "add", "ann")
    await access.look()
    visitor = access.visitor(await access.log_in("ann", PASSWORD, "a"), Kind.SESSION)
    assert visitor is not None
    assert visitor.role is Role.VIEWER
    await users(tmp_path, "token", "ann", days=1)
    token = capsys.readouterr().out.splitlines()[-1]
    await access.look()
    assert access.visitor(token, Kind.TOKEN) is not None
    says(monkeypatch, PASSWORD[::-1])
    await users(tmp_path, "reset", "ann", role="operator")
    await access.look()
    assert (visitor.may_look, access.visitor(token, Kind.TOKEN)) == (False, None)
    visitor = access.visitor(await access.log_in("ann", PASSWORD[::-1], "a"), Kind.SESSION)
    assert visitor is not None
    assert visitor.role is Role.OPERATOR
    await users(tmp_path, "list")
    assert capsys.readouterr().out.splitlines()[-1] == "ann operator"
    await users(tmp_path, "remove", "ann")
    await access.look()
    assert (visitor.may_look, access.needs_setup) == (False, True)


async def test_interrupted_while_it_asks_for_a_password_the_terminal_shows_again_what_is_typed(tmp_path: Path) -> None:
    hand, terminal = pty.openpty()
    asked = [sys.executable, "-m", "services.toolbox", "users", "add", "ann", "--history", f"sqlite:///{tmp_path}/u.db"]
    process = await asyncio.create_subprocess_exec(
        *asked, stdin=terminal, stderr=asyncio.subprocess.PIPE, start_new_session=True
    )
    try:
        await until(lambda: not echoes(terminal))
        process.send_signal(signal.SIGINT)
        async with asyncio.timeout(PATIENCE_S):
            await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        shown = echoes(terminal)
        os.close(hand)
        os.close(terminal)
    assert (process.returncode, shown) == (128 + signal.SIGINT, True)


def echoes(terminal: int) -> bool:
    return bool(termios.tcgetattr(terminal)[3] & termios.ECHO)


async def test_what_cannot_be_done_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    says(monkeypatch, PASSWORD)
    await users(tmp_path, "add", "ann")
    for task, name, reason in (
        ("add", "ann", "there is a user ann already"),
        ("add", "a b", "a user's name"),
        ("reset", "bob", "no user bob"),
        ("remove", "bob", "no user bob"),
        ("token", "bob", "no user bob"),
        ("token", "", "a user's name"),
    ):
        says(monkeypatch, PASSWORD)
        with pytest.raises(UsersError, match=reason):
            await users(tmp_path, task, name)


@pytest.mark.parametrize("task", ["list", "remove", "reset", "token"])
async def test_only_adding_somebody_makes_a_database(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, task: str
) -> None:
    says(monkeypatch, PASSWORD)
    with pytest.raises(HistoryError, match=r"users\.db: it does not exist"):
        await users(tmp_path, task, "" if task == "list" else "ann")
    assert names(tmp_path) == []


async def test_a_password_that_will_not_do_makes_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    says(monkeypatch, "short")
    with pytest.raises(UsersError, match="10 to 256"):
        await users(tmp_path, "add", "ann")
    assert names(tmp_path) == []


async def test_an_e_mail_address_is_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("r10@fleet.example", "ann.o'neil+night-shift@fleet.example", "r2@fleet.example"):
        says(monkeypatch, PASSWORD)
        await users(tmp_path, "add", name)
    access = access_to(tmp_path)
    await access.look()
    assert await access.log_in("r2@fleet.example", PASSWORD, "a")
    await users(tmp_path, "list")
    assert [line.split("@")[0] for line in capsys.readouterr().out.splitlines()[-3:]] == [
        "ann.o'neil+night-shift",
        "r2",
        "r10",
    ]
    with pytest.raises(UsersError, match=r"as in bob or bob@fleet\.example"):
        await users(tmp_path, "add", "@fleet.example")


async def test_the_database_is_named_beside_what_programs_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    says(monkeypatch, PASSWORD)
    await users(tmp_path, "add", "ann")
    assert capsys.readouterr() == ("ann may log in: viewer\n", f"database: {tmp_path}/users.db\n")
    await users(tmp_path, "list")
    assert capsys.readouterr() == ("ann viewer\n", f"database: {tmp_path}/users.db\n")
    with pytest.raises(UsersError, match="no user bob"):
        await users(tmp_path, "remove", "bob")
    assert capsys.readouterr() == ("", f"database: {tmp_path}/users.db\n")


async def test_a_user_of_a_newer_version_can_be_removed_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    await newer(tmp_path)
    for task, reason in (("add", "there is a user carl"), ("reset", "does not know"), ("token", "does not know")):
        says(monkeypatch, PASSWORD)
        with pytest.raises(UsersError, match=reason):
            await users(tmp_path, task, "carl")
    await users(tmp_path, "remove", "carl")
    assert capsys.readouterr().out.splitlines() == ["carl may not log in any more"]
    assert await UserStore(users_in(tmp_path)).add(User("carl", Role.VIEWER, "x", 1))


@pytest.mark.parametrize("task", ["token", "remove", "list"])
def test_a_role_is_only_taken_where_it_is_given_to_somebody(task: str) -> None:
    with pytest.raises(ValidationError, match="only add and reset do"):
        UsersSettings.model_validate({"task": task, "name": "ann", "role": "viewer"})


def test_on_a_terminal_a_password_is_asked_for_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr("sys.stdin", Terminal())
    assert read_password(lambda _: PASSWORD) == PASSWORD
    with pytest.raises(UsersError, match="not the same"):
        read_password(lambda asked: asked)
