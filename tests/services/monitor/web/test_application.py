"""Methods that a path takes, and the cookie and origin it is served under."""

import httpx
import pytest
from pydantic import ValidationError

from bus.fake import FakeNetwork
from services.monitor.settings import MonitorSettings
from services.monitor.web.auth.users import Role
from tests.services.monitor.web.asking import ORIGIN, Web
from tests.services.monitor.web.serving import monitor_on, served


@pytest.mark.parametrize("path", ["/healthz", "/login", "/metrics", "/api/v1/robots", "/api/openapi.json"])
async def test_head_is_answered_as_get_is_without_a_body(path: str) -> None:
    async with FakeNetwork().open_bus() as bus, served(monitor_on(bus)) as at:
        token = {"Authorization": f"Bearer {at.token}"}
        async with httpx.AsyncClient(base_url=at.url, headers=token, timeout=60) as program:
            head, get = await program.head(path), await program.get(path)
            assert (head.status_code, head.content) == (200, b"")
            assert head.headers["Content-Type"] == get.headers["Content-Type"]
            assert "Content-Length" in head.headers


async def test_head_lets_a_stranger_no_further_than_get(web: Web) -> None:
    async with web.stranger() as stranger:
        assert (await stranger.head("/healthz")).status_code == 200
        assert (await stranger.head("/metrics")).status_code == 401
        assert (await stranger.head("/api/v1/me")).status_code == 401
    async with await web.program() as program:
        assert (await program.head("/api/v1/robots?robt=r1")).status_code == 422


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("GET", "/api/v1/alerts/x/acknowledge", "POST"),
        ("PUT", "/api/v1/alerts/x/acknowledge", "POST"),
        ("HEAD", "/api/v1/robots/r1/forget", "POST"),
        ("POST", "/api/v1/robots", "GET, HEAD"),
        ("OPTIONS", "/api/v1/robots", "GET, HEAD"),
        ("DELETE", "/healthz", "GET, HEAD"),
        ("POST", "/metrics", "GET, HEAD"),
        ("PUT", "/login", "GET, HEAD, POST"),
        ("GET", "/logout", "POST"),
    ],
)
async def test_a_method_that_is_not_taken_is_refused_with_those_that_are(
    web: Web, method: str, path: str, allowed: str
) -> None:
    async with await web.program() as program:
        answer = await program.request(method, path, headers={"Origin": ORIGIN})
        assert (answer.status_code, answer.headers["Allow"]) == (405, allowed)
        if method != "HEAD":
            assert answer.json() == {"error": f"{path} takes {allowed.replace(', ', ' or ')}, not {method}"}


async def test_where_there_is_nothing_that_is_said_whatever_the_method(web: Web) -> None:
    async with await web.program() as program:
        for method in ("GET", "POST", "PUT", "DELETE"):
            answer = await program.request(method, "/api/v1/robts")
            assert (answer.status_code, answer.json()) == (404, {"error": "there is no /api/v1/robts"})


async def test_who_may_not_act_does_not_learn_how(web: Web) -> None:
    async with await web.program(Role.VIEWER) as viewer:
        assert (await viewer.post("/api/v1/robots")).status_code == 403


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
