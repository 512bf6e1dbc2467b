from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from tests.services.monitor.history.support.postgresql import PostgreSQL, running_postgresql

numbers = count()


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """Debian's real server."""
    with running_postgresql() as server:
        yield server


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database of either kind."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path}/new/history.db"
    server: PostgreSQL = request.getfixturevalue("postgresql")
    return server.create(f"history_{next(numbers)}")
