"""The web server: its port and its page."""

import re
import socket

import httpx
import pytest

from bus.fake import FakeNetwork
from services.monitor.settings import MonitorSettings
from services.monitor.web.process import WebError, open_listener, url_of
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


def test_a_port_that_is_taken_is_said() -> None:
    with open_listener(MonitorSettings(web_port=0)) as listener:
        port = listener.getsockname()[1]
        assert url_of(listener, MonitorSettings()) == f"http://127.0.0.1:{port}"
        with pytest.raises(
            WebError, match=f"--web-host 127.0.0.1 --web-port {port}: Address already in use; set another --web-port,"
        ):
            open_listener(MonitorSettings(web_port=port))


def test_a_host_that_is_none_is_said() -> None:
    for host in ("no such host", "203.0.113.7", "x" * 300):
        with pytest.raises(WebError, match=r"^--web-host .*; set another --web-host, or --no-web$"):
            open_listener(MonitorSettings(web_host=host, web_port=0))


def test_the_address_is_one_that_a_browser_takes() -> None:
    with open_listener(MonitorSettings(web_host="::1", web_port=0)) as listener:
        assert url_of(listener, MonitorSettings()).startswith("http://[::1]:")
    with open_listener(MonitorSettings(web_host="0.0.0.0", web_port=0)) as listener:  # noqa: S104 - on purpose
        assert url_of(listener, MonitorSettings()).startswith(f"http://{socket.gethostname()}:")
        assert url_of(listener, MonitorSettings(web_url="https://fleet.example/")) == "https://fleet.example"  # type: ignore[arg-type]


def test_a_host_s_name_that_does_not_resolve_is_said_in_words() -> None:
    with pytest.raises(WebError, match=r"^--web-host no-such-host\.invalid --web-port 0: [A-Z][a-z ]+;"):
        open_listener(MonitorSettings(web_host="no-such-host.invalid", web_port=0))
