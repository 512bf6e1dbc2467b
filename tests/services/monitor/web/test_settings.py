import pytest
from pydantic import ValidationError

from services.monitor.settings import MonitorSettings


def test_the_page_is_for_this_machine_only_unless_told_otherwise() -> None:
    settings = MonitorSettings()
    assert (settings.web, settings.web_host, settings.web_port) == (True, "127.0.0.1", 8080)
    assert (settings.web_open_metrics, settings.web_url) == (False, None)


@pytest.mark.parametrize("url", ["https://fleet.example", "https://fleet.example/", "http://10.0.0.1:8443"])
def test_a_proxy_shows_the_page_at_the_root_of_its_host(url: str) -> None:
    assert str(MonitorSettings.model_validate({"web_url": url}).web_url).rstrip("/") == url.rstrip("/")


@pytest.mark.parametrize("rest", ["x", "x/", "?a=b", "#a"])
def test_a_proxy_that_shows_the_page_elsewhere_is_refused(rest: str) -> None:
    with pytest.raises(ValidationError) as caught:
        MonitorSettings.model_validate({"web_url": f"https://fleet.example/{rest}"})
    (error,) = caught.value.errors()
    assert (error["loc"], "root of its host" in error["msg"]) == (("web_url",), True)
