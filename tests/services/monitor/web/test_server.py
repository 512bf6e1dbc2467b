import re

import httpx
import pytest

from bus.fake import FakeNetwork
from tests.services.monitor.web.serving import monitor_on, served


@pytest.mark.parametrize("number", [1, 2])
async def test_the_page_fetches_nothing_from_elsewhere(number: int) -> None:
    async with FakeNetwork().open_bus() as bus, served(monitor_on(bus)) as at:
        async with httpx.AsyncClient(base_url=at.url, cookies=dict([at.cookie])) as browser:
            page = (await browser.get("/")).text
            own = re.findall(r'(?:src|href)="(/[^"]+)"', page)
            assert own
            for path in own:
                assert (await browser.get(path)).status_code == 200
        assert not re.findall(r'(?:src|href)="(?!/|data:)', page), number
        assert not re.findall(r'@import url\("(?!/)', page)
