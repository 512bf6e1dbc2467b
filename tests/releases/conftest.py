from collections.abc import Iterator

import pytest

from tests.services.monitor.history.support.postgresql import PostgreSQL, running_postgresql


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """Debian's real server."""
    with running_postgresql() as server:
        yield server
