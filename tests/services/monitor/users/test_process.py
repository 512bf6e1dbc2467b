import io
from pathlib import Path

import pytest

from services.monitor.users.process import UsersError, read_password, run
from services.monitor.users.settings import UsersSettings
from services.monitor.web.auth.people import Kind
from services.monitor.web.auth.visitor import Role
from tests.services.monitor.web.auth.test_access import access_to

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


async def test_what_cannot_be_done_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    says(monkeypatch, "short")
    with pytest.raises(UsersError, match="10 to 256"):
        await users(tmp_path, "add", "ann")
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
        with pytest.raises(UsersError, match=reason):
            await users(tmp_path, task, name)


def test_on_a_terminal_a_password_is_asked_for_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr("sys.stdin", Terminal())
    assert read_password(lambda _: PASSWORD) == PASSWORD
    with pytest.raises(UsersError, match="not the same"):
        read_password(lambda asked: asked)
