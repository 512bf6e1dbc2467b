import httpx
import pytest

from bus.fake import FakeNetwork
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
