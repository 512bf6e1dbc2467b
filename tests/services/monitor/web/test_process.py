"""The web server: its port, its limits, its HTTP."""

import asyncio
import re
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

import httpx
import pytest
from starlette.responses import PlainTextResponse
from uvicorn import Config
from uvicorn.server import ServerState

from bus.fake import FakeNetwork
from services.monitor.settings import MonitorSettings
from services.monitor.web.process import WebError, open_listener, url_of
from services.monitor.web.server import HEAD_S, MAX_HEAD_BYTES, TURNED_AWAY, BoundedProtocol
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


ASKED = b"GET / HTTP/1.1\r\nHost: here\r\n\r\n"
Connect = Callable[..., "asyncio.Future[tuple[asyncio.StreamReader, asyncio.StreamWriter]]"]


@asynccontextmanager
async def listening(head_s: float = HEAD_S, most: int = 10) -> AsyncIterator[tuple[Connect, ServerState]]:
    config = Config(PlainTextResponse("ok"), limit_concurrency=most, log_config=None, timeout_keep_alive=60)
    config.load()
    state = ServerState()
    loop = asyncio.get_running_loop()
    server = await loop.create_server(
        lambda: BoundedProtocol(config=config, server_state=state, app_state={}, _loop=loop, head_s=head_s), "127.0.0.1"
    )
    writers: list[asyncio.StreamWriter] = []

    async def connect(own: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname(), local_addr=(own, 0))
        writers.append(writer)
        return reader, writer

    try:
        yield lambda own="127.0.0.1": asyncio.ensure_future(connect(own)), state
    finally:
        for writer in writers:
            writer.close()
            with suppress(ConnectionError):
                await writer.wait_closed()
        server.close()
        await server.wait_closed()
        async with asyncio.timeout(30):
            while state.connections:  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.01)


async def ended(reader: asyncio.StreamReader) -> bytes:
    """Return what was still sent before the other side closed."""
    async with asyncio.timeout(30):
        try:
            return await reader.read()
        except ConnectionError:
            return b""


@pytest.mark.parametrize("begin", [b"", b"GET / HT", ASKED[:-2]])
async def test_who_never_ends_a_request_is_let_go(begin: bytes) -> None:
    async with listening(head_s=0.05) as (connect, state):
        reader, writer = await connect()
        writer.write(begin)
        assert await ended(reader) == b""
        assert not state.connections


async def test_a_second_request_has_to_end_too() -> None:
    async with listening(head_s=0.2) as (connect, _):
        reader, writer = await connect()
        writer.write(ASKED)
        assert (await reader.readuntil(b"ok")).startswith(b"HTTP/1.1 200")
        writer.write(ASKED[:-2])
        assert await ended(reader) == b""


async def test_who_ends_a_request_may_stay_and_ask_again() -> None:
    async with listening(head_s=0.2) as (connect, state):
        reader, writer = await connect()
        for part in (ASKED[:5], ASKED[5:], ASKED):
            writer.write(part)
        for _ in range(2):
            assert (await reader.readuntil(b"ok")).startswith(b"HTTP/1.1 200")
        await asyncio.sleep(0.4)
        assert len(state.connections) == 1


@pytest.mark.parametrize(("length", "is_taken"), [(MAX_HEAD_BYTES - 200, True), (4 * MAX_HEAD_BYTES, False)])
async def test_a_head_that_goes_on_and_on_is_not_kept(length: int, is_taken: bool) -> None:  # noqa: FBT001 - a parameter
    async with listening() as (connect, _):
        reader, writer = await connect()
        writer.write(ASKED[:-2] + b"x: " + b"y" * length)
        if is_taken:
            writer.write(b"\r\n\r\n")
            assert (await reader.readuntil(b"ok")).startswith(b"HTTP/1.1 200")
        else:
            assert await ended(reader) == b""


async def test_of_too_many_connections_some_are_told_and_the_rest_closed() -> None:
    async with listening(most=1) as (connect, state):
        held = [await connect() for _ in range(1 + TURNED_AWAY)]
        over, _ = await connect()
        assert await ended(over) == b""
        assert len(state.connections) == 1 + TURNED_AWAY
        reader, writer = held[-1]
        writer.write(ASKED)
        assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 503")


async def test_one_address_leaves_connections_to_others() -> None:
    async with listening(most=80) as (connect, state):
        for _ in range(20):
            await connect("127.0.0.2")
        over, _ = await connect("127.0.0.2")
        assert await ended(over) == b""
        assert len(state.connections) == 20
        reader, writer = await connect("127.0.0.3")
        writer.write(ASKED)
        assert (await reader.readuntil(b"ok")).startswith(b"HTTP/1.1 200")
        for _ in range(25):
            reader, writer = await connect("127.0.0.1")
            writer.write(ASKED)
            assert (await reader.readuntil(b"ok")).startswith(b"HTTP/1.1 200"), "a proxy speaks for everybody"
