import asyncio
from collections.abc import AsyncIterator

import httpx
import pytest
from fastapi.routing import iter_route_contexts
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.monitor.web.application import cookie_of
from services.monitor.web.auth.gate import OPEN, ServedAt
from services.monitor.web.auth.middleware import AccessMiddleware
from services.monitor.web.auth.users import Role
from services.monitor.web.connections import KNOWN
from tests.services.monitor.web.asking import ORIGIN, Web

FILLED = {"alert_id": "a1", "robot": "r1", "path": "v1/what", "site": "hall", "object_id": "o1", "name": "berlin"}
ANYBODYS_POSTS = {"/login", "/setup", "/logout"}


def every_call(web: Web) -> list[tuple[str, str]]:
    """Return method and path of everything that the application answers."""
    found = {
        (method, str(route.path).replace(":path", "").format(**FILLED))
        for route in iter_route_contexts(web.app.routes)
        for method in route.methods or ()
    }
    assert {("GET", "/metrics"), ("GET", "/api/openapi.json"), ("POST", "/api/v1/alerts/a1/resolve")} < found
    return sorted(found - {(method, path) for method, path in found if method == "HEAD"})


async def status(client: httpx.AsyncClient, method: str, path: str) -> int:
    return (await client.request(method, path)).status_code


async def test_a_stranger_gets_nowhere_but_to_the_doors(web: Web) -> None:
    async with web.stranger() as stranger:
        for method, path in every_call(web):
            if path not in OPEN:
                found = await status(stranger, method, path)
                assert found in ((401, 403) if method != "GET" or path.startswith(("/api/", "/metrics")) else (303,)), (
                    path
                )


async def test_a_viewer_may_read_everything_and_change_nothing(web: Web) -> None:
    async with await web.program(Role.VIEWER) as viewer:
        for method, path in every_call(web):
            if method == "GET":
                assert await status(viewer, method, path) not in (401, 403), path
            elif path not in ANYBODYS_POSTS:
                assert await status(viewer, method, path) == 403, path


async def test_an_operator_may_do_everything(web: Web) -> None:
    async with await web.program() as operator:
        for method, path in every_call(web):
            assert await status(operator, method, path) not in (401, 403) or path in ANYBODYS_POSTS, path


OTHERS = ["http://elsewhere.test", "http://localhost:1.evil", "null", "", "http://localhost:2"]


async def test_another_sites_page_changes_nothing_whoever_is_logged_in(web: Web) -> None:
    async with await web.browser() as browser, await web.program() as program:
        for client in (browser, program):
            for number, (method, path) in enumerate(every_call(web)):
                if method != "GET":
                    origin = OTHERS[number % len(OTHERS)]
                    assert (await client.request(method, path, headers={"Origin": origin})).status_code == 403, path
        for origin in OTHERS:
            assert (await browser.post("/logout", headers={"Origin": origin})).status_code == 403
        assert (await browser.get("/api/v1/me")).status_code == 200


async def test_a_browser_that_does_not_name_its_page_changes_nothing(web: Web) -> None:
    async with await web.browser() as browser:
        del browser.headers["Origin"]
        assert await status(browser, "POST", "/api/v1/alerts/a1/resolve") == 403
        browser.headers["Origin"] = ORIGIN
        assert await status(browser, "POST", "/api/v1/alerts/a1/resolve") == 404


async def test_a_session_is_no_token_and_a_token_no_session(web: Web) -> None:
    async with await web.browser() as browser, await web.program() as program:
        ((name, session),) = browser.cookies.items()
        token = program.headers["Authorization"].removeprefix("Bearer ")
        async with web.stranger(Authorization=f"Bearer {session}") as swapped:
            assert await status(swapped, "GET", "/api/v1/me") == 401
        async with web.stranger(Cookie=f"{name}={token}") as swapped:
            assert await status(swapped, "GET", "/api/v1/me") == 401


async def test_a_wrong_token_counts_even_beside_a_good_session(web: Web) -> None:
    async with await web.browser() as browser:
        for given in (b"Bearer", b"Bearer x", b"Basic b3BlcmF0b3I6eA==", b"\xe9", b"Bearer \xff" * 99, b"bearer  "):
            answer = await browser.get("/api/v1/me", headers=[(b"Authorization", given)])
            assert (answer.status_code, answer.headers["WWW-Authenticate"]) == (401, "Bearer")


async def test_a_stranger_is_sent_to_log_in_and_back(web: Web) -> None:
    async with web.stranger() as stranger:
        assert (await stranger.get("/alerts/x y")).headers["Location"] == "/login?next=/alerts/x%20y"
        assert (await stranger.get("/?search=r%201")).headers["Location"] == "/login?next=/%3Fsearch%3Dr%25201"
        assert (await stranger.get("/")).headers["Location"] == "/login"
        assert (await stranger.get("/_nicegui/x.js")).headers["Location"].startswith("/login")


async def test_what_only_looks_like_a_door_is_none(web: Web) -> None:
    async with web.stranger() as stranger:
        for path in (b"/login/", b"//login", b"/healthz/..", b"/LOGIN", b"/login/../api/v1/me", b"/healthz%2f..%2fapi"):
            assert (await stranger.get(httpx.URL(ORIGIN, raw_path=path))).status_code in (303, 401), path


async def test_too_much_is_refused_before_and_while_it_comes(web: Web) -> None:
    async def parts() -> object:
        for _ in range(20):
            yield bytes(8 * 1024)

    async with web.stranger(Origin=ORIGIN) as stranger:
        announced = await stranger.post("/login", content=bytes(65 * 1024))
        assert (announced.status_code, announced.json()) == (
            413,
            {"error": "a request to /login has at most 65536 bytes"},
        )
        assert (await stranger.post("/login", content=parts())).status_code == 413  # type: ignore[arg-type]


def guarding(web: Web, app: ASGIApp) -> AccessMiddleware:
    cookie = cookie_of(web.monitor.settings)
    return AccessMiddleware(app, web.access, cookie=cookie, place=ServedAt(), most_of_user=3, body_s=0.05, gone_s=0.05)


async def test_one_user_leaves_requests_and_sockets_to_others(web: Web) -> None:
    """Whatever addresses they come from: a proxy on this machine has no share of its own."""
    ends, begun, known = asyncio.Event(), asyncio.Queue[str](), list[str]()

    async def slow(scope: Scope, _: Receive, send: Send) -> None:
        begun.put_nowait(scope["type"])
        await ends.wait()
        if scope["type"] == "http":
            await PlainTextResponse("ok")(scope, _, send)

    app = guarding(web, slow)

    async def request(kind: str, token: str, status: list[int]) -> None:
        async def send(message: Message) -> None:
            status.append(message.get("status", 0))

        headers = [(b"authorization", token.encode())]
        scope: Scope = {"type": kind, "path": "/api/v1/live", "headers": headers, KNOWN: lambda: known.append(kind)}
        if kind == "http":
            scope["method"] = "GET"
        await app(scope, asyncio.Event().wait, send)  # type: ignore[arg-type]

    async with (
        await web.program() as operator,
        await web.program(Role.VIEWER) as viewer,
        asyncio.timeout(30),
        asyncio.TaskGroup() as group,
    ):
        one, other = (str(each.headers["Authorization"]) for each in (operator, viewer))
        served: list[int] = []
        for kind in ("http", "http", "websocket"):
            group.create_task(request(kind, one, served))
            assert await begun.get() == kind
        for kind in ("http", "websocket"):
            refused: list[int] = []
            await request(kind, one, refused)
            assert refused[0] == 503
        group.create_task(request("http", other, served))
        assert await begun.get() == "http"
        ends.set()
    assert served.count(200) == 3
    assert known == ["http", "http", "websocket", "http"]
    again: list[int] = []
    await request("http", one, again)
    assert again[0] == 200, "what has ended no longer counts"


async def test_a_stranger_s_connection_stays_a_stranger_s(web: Web) -> None:
    known: list[str] = []

    async def marked(scope: Scope, receive: Receive, send: Send) -> None:
        await guarding(web, web.app)({**scope, KNOWN: lambda: known.append(scope["path"])}, receive, send)

    async with httpx.AsyncClient(transport=httpx.ASGITransport(marked), base_url=ORIGIN) as stranger:
        for path in ("/healthz", "/login", "/", "/api/v1/me"):
            await stranger.get(path)
        assert known == []
        await stranger.get("/api/v1/me", headers=dict((await web.program()).headers))
        assert known == ["/api/v1/me"]


async def test_who_never_ends_a_request_gets_no_place_for_it(web: Web) -> None:
    async def never() -> AsyncIterator[bytes]:
        yield b"name="
        await asyncio.Event().wait()

    transport = httpx.ASGITransport(guarding(web, web.app))
    async with httpx.AsyncClient(transport=transport, base_url=ORIGIN, headers={"Origin": ORIGIN}) as slow:
        answer = await slow.post("/login", content=never())
        assert (answer.status_code, answer.headers["Connection"]) == (408, "close")


async def test_a_socket_of_which_nothing_is_taken_ends(web: Web) -> None:
    taken: list[str] = []

    async def page(_: Scope, receive: Receive, send: Send) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        with pytest.raises(TimeoutError):
            await send({"type": "websocket.send", "text": "more than it takes"})
        await send({"type": "websocket.send", "text": "and more"})
        assert (await receive())["type"] == "websocket.disconnect"

    async def take(message: Message) -> None:
        taken.append(str(message["type"]))
        if message["type"] == "websocket.send":
            await asyncio.Event().wait()

    said: asyncio.Queue[Message] = asyncio.Queue()
    said.put_nowait({"type": "websocket.connect"})
    async with await web.program() as program:
        headers = [(b"authorization", program.headers["Authorization"].encode())]
    async with asyncio.timeout(30):
        await guarding(web, page)({"type": "websocket", "path": "/api/v1/live", "headers": headers}, said.get, take)
    assert taken == ["websocket.accept", "websocket.send"]


async def test_browsers_are_told_to_fetch_nothing_from_elsewhere_and_to_keep_nothing(web: Web) -> None:
    async with await web.browser() as browser:
        for path in ("/login", "/api/v1/me", "/healthz", "/api/v1/what"):
            headers = (await browser.get(path)).headers
            assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
            assert not {"http:", "https:", "*"} & set(headers["Content-Security-Policy"].split())
            assert (headers["X-Content-Type-Options"], headers["Cache-Control"]) == ("nosniff", "no-store")
