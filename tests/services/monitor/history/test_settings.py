from pathlib import Path

import pytest

from services.monitor.history.settings import NONE, default_url
from services.monitor.web.auth.store import users_url


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
