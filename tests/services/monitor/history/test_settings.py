from pathlib import Path

import pytest

from services.monitor.history.settings import NONE, HistorySettings, default_url
from services.monitor.web.auth.store import users_url
from services.toolbox.errors import UsageError
from services.toolbox.settings import load


def test_what_is_kept_is_in_the_folder_that_the_user_names_for_state(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert default_url() == f"sqlite:///{tmp_path}/state/fleetsight/history.db"
    assert users_url(NONE) == f"sqlite:///{tmp_path}/state/fleetsight/users.db"


def test_unless_the_user_names_one_it_is_in_their_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", "")
    assert default_url() == f"sqlite:///{tmp_path}/.local/state/fleetsight/history.db"
    assert users_url(NONE) == f"sqlite:///{tmp_path}/.local/state/fleetsight/users.db"


@pytest.mark.parametrize(
    "url",
    [
        NONE,
        "sqlite:////var/lib/fleetsight/history.db",
        "postgresql://ann:secret@db:5433/fleet?ssl=require",
        "postgresql://ann:s/e:cret@[fd00::1]:5433/fleet",
        "postgresql://ann:secret@db/fleet",
        "postgresql://db/fleet",
        "postgresql:///fleet?host=/run/postgresql",
    ],
)
def test_a_database_is_taken_as_it_is(url: str) -> None:
    assert HistorySettings(history=url).history == url


WRITE_IT = "write it like sqlite:////var/lib/fleetsight/history.db or postgresql://user@host/db, or none"
NO_FILE = "it names no file, and so keeps nothing; none says that"
NO_PORT = "what follows its host is no port, a number up to 65535; write @ in a password as %40"


@pytest.mark.parametrize(
    ("url", "shown", "reason"),
    [
        ("postgresqlX://ann:SECRET@db/fleet", "postgresqlX://...", WRITE_IT),
        ("postgresql:/ann:SECRET@db/fleet", "...", WRITE_IT),
        ("sqlite:///", "sqlite://...", NO_FILE),
        ("sqlite:///:memory:", "sqlite://...", NO_FILE),
        ("sqlite:///:memory:?cache=shared", "sqlite://...", NO_FILE),
        ("ann:SECRET@db/fleet", "...", WRITE_IT),
        ("postgresql://ann:SECRET\udcff@db/fleet", "postgresql://...", WRITE_IT),
        ("postgresql://ann:SECRET@db:bad/fleet", "postgresql://...", NO_PORT),
        ("postgresql://ann@db:65536", "postgresql://...", NO_PORT),
        ("postgresql://ann:SECRET", "postgresql://...", NO_PORT),
        ("postgresql://ann:a@SECRET:more@db/fleet", "postgresql://...", NO_PORT),
    ],
)
def test_a_database_that_is_none_is_said_without_what_may_be_secret(url: str, shown: str, reason: str) -> None:
    with pytest.raises(UsageError) as caught:
        load(HistorySettings, ["--history", url], prog="fleetsight monitor")
    assert str(caught.value) == f"--history {shown!r}: {reason}"


def test_a_database_in_a_file_s_list_is_said_without_what_may_be_secret(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("FLEETSIGHT_HISTORY")
    file = tmp_path / "monitor.yaml"
    file.write_text("history: [postgresql://ann:SECRET@db/fleet]")
    with pytest.raises(UsageError) as caught:
        load(HistorySettings, ["--config", str(file)], prog="fleetsight monitor")
    assert str(caught.value) == f"{file}: line 1: history '...': {WRITE_IT}"
