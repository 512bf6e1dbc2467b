"""Bounds of the web server's connections: slow and endless requests and TLS handshakes, too many of one address."""

import asyncio
import ssl
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

import pytest
from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send
from uvicorn import Config
from uvicorn.server import ServerState

from services.monitor.settings import WebSettings
from services.monitor.web.connections import HANDSHAKE_S, KNOWN, TURNED_AWAY, Acceptor
from services.monitor.web.process import PageTls, open_listener
from services.monitor.web.server import HEAD_S, MAX_HEAD_BYTES, BoundedProtocol
from tests.bus.certificates import certificate, make_certificates

ASKED = b"GET / HTTP/1.1\r\nHost: here\r\n\r\n"
Stream = tuple[asyncio.StreamReader, asyncio.StreamWriter]
Connect = Callable[..., "asyncio.Future[Stream]"]


LOGGED_IN = b"GET /logged-in HTTP/1.1\r\nHost: here\r\n\r\n"


async def answer(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer as the application does, for which somebody is logged in at one path alone."""
    if scope["path"] == "/logged-in":
        scope[KNOWN]()
    await PlainTextResponse("ok")(scope, receive, send)


@asynccontextmanager
async def listening(
    head_s: float = HEAD_S, most: int = 10, tls: ssl.SSLContext | None = None, handshake_s: float = HANDSHAKE_S
) -> AsyncIterator[tuple[Connect, ServerState]]:
    """Serve on a free port; yields how to connect to it, and the server's connections."""
    config = Config(answer, limit_concurrency=most, log_config=None, timeout_keep_alive=60)
    config.load()
    state = ServerState()

    def protocol() -> BoundedProtocol:
        return BoundedProtocol(config, state, {}, head_s=head_s)

    listener = open_listener(WebSettings(web_port=0))
    accepting = asyncio.create_task(Acceptor(state, protocol, most, tls, handshake_s=handshake_s).run(listener))
    writers: list[asyncio.StreamWriter] = []

    async def connect(own: str, tls: ssl.SSLContext | None) -> Stream:
        name = None if tls is None else "localhost"
        at = listener.getsockname()
        reader, writer = await asyncio.open_connection(*at, local_addr=(own, 0), ssl=tls, server_hostname=name)
        writers.append(writer)
        return reader, writer

    try:
        yield lambda own="127.0.0.1", tls=None: asyncio.ensure_future(connect(own, tls)), state
    finally:
        for writer in writers:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()
        accepting.cancel()
        with suppress(asyncio.CancelledError):
            await accepting
        listener.close()
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
    async with listening(most=10) as (connect, state):
        for _ in range(8):
            await logged_in(connect)
        reader, writer = await logged_in(connect)
        await reader.readuntil(b"ok")
        for number in range(10, 10 + TURNED_AWAY + 1):
            await connect()
            async with asyncio.timeout(30):
                while len(state.connections) < number:  # noqa: ASYNC110 - nobody tells
                    await asyncio.sleep(0.01)
            for connection in state.connections:
                connection.is_stranger = False  # type: ignore[union-attr]
        over, _ = await connect()
        assert await ended(over) == b""
        assert len(state.connections) == 10 + TURNED_AWAY
        writer.write(ASKED)
        assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 503")


async def logged_in(connect: Connect, address: str = "127.0.0.1") -> Stream:
    """Return a connection of somebody who is logged in."""
    reader, writer = await connect(address)
    writer.write(LOGGED_IN)
    async with asyncio.timeout(30):
        assert (await reader.readline()).startswith(b"HTTP/1.1 200")
    return reader, writer


async def test_strangers_from_anywhere_leave_room_for_those_who_are_logged_in() -> None:
    async with listening(most=20) as (connect, state):
        first, writer = await logged_in(connect)
        await first.readuntil(b"ok")
        idle = [await connect(f"127.0.{1 + number // 200}.{1 + number % 200}") for number in range(150)]
        for number in range(15):
            await logged_in(connect, address=f"127.0.9.{1 + number}")
        assert await ended(idle[0][0]) == b"", "the oldest stranger gave way"
        newest = asyncio.create_task(idle[-1][0].read())
        assert len(state.connections) <= 20 + TURNED_AWAY
        writer.write(LOGGED_IN)
        assert (await first.readline()).startswith(b"HTTP/1.1 200"), "no stranger takes a place from who is logged in"
        assert not newest.done()
        newest.cancel()


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


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> tuple[ssl.SSLContext, ssl.SSLContext]:
    """Return the contexts of the server and of a browser."""
    folder = tmp_path_factory.mktemp("certificates")
    make_certificates(folder)
    own = certificate(folder, "central")
    trusting = ssl.create_default_context(cafile=str(folder / "ca.pem"))
    return PageTls(own["tls_certificate"], own["tls_key"]).context, trusting


Tls = tuple[ssl.SSLContext, ssl.SSLContext]


def hello(browser: ssl.SSLContext) -> bytes:
    """Return the first message of a handshake."""
    sent = ssl.MemoryBIO()
    with suppress(ssl.SSLWantReadError):
        browser.wrap_bio(ssl.MemoryBIO(), sent, server_hostname="localhost").do_handshake()
    return sent.read()


async def drip(writer: asyncio.StreamWriter, data: bytes) -> None:
    """Send a byte, and soon after it another one, for as long as there are any."""
    for at in range(len(data)):
        writer.write(data[at : at + 1])
        await asyncio.sleep(0.02)


async def get(connect: Connect, address: str, browser: ssl.SSLContext) -> bytes:
    """Return the first line of an answer, nothing if the connection is closed."""
    async with asyncio.timeout(30):
        try:
            reader, writer = await connect(address, browser)
            writer.write(ASKED)
            return await reader.readline()
        except ConnectionError:
            return b""


@pytest.mark.parametrize("begin", ["nothing", "half", "whole", "drips"])
async def test_a_handshake_without_end_is_cut_off(tls: Tls, begin: str) -> None:
    server, browser = tls
    data = hello(browser)
    async with listening(tls=server, handshake_s=0.5) as (connect, state):
        reader, writer = await connect("127.0.0.2")
        dripping = asyncio.create_task(drip(writer, data if begin == "drips" else b""))
        writer.write({"nothing": b"", "half": data[: len(data) // 2], "whole": data, "drips": b""}[begin])
        answered = await ended(reader)
        assert bool(answered) == (begin == "whole"), "the server's part of the handshake"
        assert not dripping.done() or begin != "drips", "all was sent before the end"
        dripping.cancel()
        assert not state.connections
        assert await get(connect, "127.0.0.2", browser) == b"HTTP/1.1 200 OK\r\n"


async def test_handshakes_count_as_connections_of_their_address(tls: Tls) -> None:
    server, browser = tls
    async with listening(tls=server, most=80) as (connect, state):
        begun = [await connect("127.0.0.2") for _ in range(20)]
        over, _ = await connect("127.0.0.2")
        assert await ended(over) == b""
        assert not state.connections
        assert await get(connect, "127.0.0.3", browser) == b"HTTP/1.1 200 OK\r\n"
        for _, writer in begun:
            writer.close()
        async with asyncio.timeout(30):
            while (answer := await get(connect, "127.0.0.2", browser)) == b"":  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.05)
        assert answer == b"HTTP/1.1 200 OK\r\n"


async def test_handshakes_of_many_addresses_give_way_to_others(tls: Tls) -> None:
    server, browser = tls
    async with listening(tls=server, most=10) as (connect, _):
        begun = [await connect(f"127.0.1.{number}") for number in range(1, 2 * (10 + TURNED_AWAY))]
        assert await get(connect, "127.0.0.2", browser) == b"HTTP/1.1 200 OK\r\n"
        newest = asyncio.create_task(begun[-1][0].read())
        assert await ended(begun[0][0]) == b""
        assert not newest.done()
        newest.cancel()


async def test_a_handshake_outlives_older_connections_of_strangers(tls: Tls) -> None:
    server, browser = tls
    async with listening(tls=server, most=20) as (connect, _):
        idle = [await connect(f"127.0.1.{number}", browser) for number in range(1, 20)]
        reader, writer = await connect("127.0.0.2")
        data = hello(browser)
        writer.write(data[:50])
        for number in range(1, 6):
            assert await get(connect, f"127.0.2.{number}", browser) == b"HTTP/1.1 200 OK\r\n"
        assert await ended(idle[0][0]) == b""
        writer.write(data[50:])
        async with asyncio.timeout(30):
            assert await reader.read(100), "its handshake goes on"
