from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.services.monitor.web.asking import Web, web_in


@pytest.fixture
async def web(tmp_path: Path) -> AsyncIterator[Web]:
    async with web_in(tmp_path) as made:
        yield made
