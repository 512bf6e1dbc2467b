"""Peers that attack a node over its own sockets: others are served meanwhile, in bounded memory."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import pytest

from gateway.ros1.errors import UnreachableError
from gateway.ros1.messages import message_type, new_message, serialise
from gateway.ros1.node import Node
from gateway.ros1.wire.header import encode_header
from gateway.ros1.xmlrpc.client import XmlRpcClient
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.support.fakes import fake_publisher
from tests.integration.peers.ros import RosProcess

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from gateway.ros1.tcpros.publisher import Publication
    from gateway.ros1.tcpros.subscriber import Message

ROOT: Final = Path(__file__).parents[3]
STRING: Final = message_type("std_msgs/String")
TIMEOUT_S: Final = 0.5
MIB: Final = 1 << 20
MAX_MESSAGE_BYTES: Final = 8 * MIB
GROWTH_BYTES: Final = 48 * MIB
PUBLISHER: Final = encode_header({"type": STRING.name, "md5sum": STRING.md5sum, "callerid": "/bad"})
SUBSCRIBER: Final = encode_header({"topic": "/out", "type": STRING.name, "md5sum": STRING.md5sum, "callerid": "/bad"})

Address = tuple[str, int]


@dataclass
class Rig:
    """The attacked process, and a well-behaved node that talks with it all the while."""

    process: RosProcess
    master: RosMaster
    client: XmlRpcClient
    good: Node
    publication: Publication
    uri: str
    tcpros: Address
    got: list[int] = field(default_factory=list)

    @property
    def xmlrpc(self) -> Address:
        return "127.0.0.1", int(self.uri.rstrip("/").rpartition(":")[2])

    def peak_bytes(self) -> int:
        """Return the most memory that the process ever had."""
        status = Path(f"/proc/{self.process.pid}/status").read_text(encoding="ascii")
        return 1024 * next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM"))

    async def keeps_talking(self) -> None:
        """Return when the victim was heard, and has heard us, some more times."""
        heard, got = self.process.output.count("heard /good"), len(self.got)
        async with asyncio.timeout(20):
            while self.process.output.count("heard /good") < heard + 3 or len(self.got) < got + 3:
                self.publication.publish(serialise(STRING.name, new_message(STRING.name, data="hello")))
                await asyncio.sleep(0.02)

    async def answers(self) -> None:
        """Return when the slave API answers."""
        async with asyncio.timeout(20):
            while True:
                with suppress(Exception):
                    assert await self.client.call(self.uri, "getPid", "/test") == self.process.pid
                    return
                await asyncio.sleep(0.05)


@asynccontextmanager
async def victim(master: RosMaster) -> AsyncIterator[RosProcess]:
    script = str(Path(__file__).with_name("hostile_victim.py"))
    process = RosProcess(
        await asyncio.create_subprocess_exec(
            sys.executable,
            *("-u", script, master.uri, str(TIMEOUT_S), str(MAX_MESSAGE_BYTES)),
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            start_new_session=True,
        )
    )
    try:
        await process.until_output("victim up")
        yield process
    finally:
        await process.end()


async def tcpros_of(client: XmlRpcClient, uri: str) -> list[Any]:
    """Ask until the node answers: its own deadline of TIMEOUT_S is short for a machine that runs other tests."""
    async with asyncio.timeout(20):
        while True:
            with suppress(UnreachableError):
                return cast("list[Any]", await client.call(uri, "requestTopic", "/test", "/out", [["TCPROS"]]))
            await asyncio.sleep(0.05)


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    got: list[int] = []

    def take(message: Message) -> None:
        got.append(len(message.data))

    async with (
        RosMaster() as master,
        victim(master) as process,
        XmlRpcClient() as client,
        Node("/good", master_uri=master.uri, poll_interval=0.2) as good,
        good.advertise("/in", STRING.name) as publication,
        good.subscribe("/out", STRING.name, take),
    ):
        async with asyncio.timeout(20):
            while "/victim" not in (await good.master.get_system_state()).publishers.get("/out", ()):  # noqa: ASYNC110
                await asyncio.sleep(0.01)
        uri = await good.master.lookup_node("/victim")
        answer = await tcpros_of(client, uri)
        made = Rig(process, master, client, good, publication, uri, (answer[1], answer[2]), got)
        await made.keeps_talking()
        yield made


@asynccontextmanager
async def growing_at_most(rig: Rig, count: int, what: str = "") -> AsyncIterator[None]:
    before = rig.peak_bytes()
    yield
    await rig.keeps_talking()
    await rig.answers()
    grown = rig.peak_bytes() - before
    assert grown <= count, f"{what}: {grown / MIB:.1f} MiB"


class Attacker:
    """One socket to the victim; what comes back is read into nothing."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writer = writer
        self._reader = reader

    async def until_closed(self) -> None:
        with suppress(ConnectionError):
            while await self._reader.read(1 << 16):
                pass


@asynccontextmanager
async def attackers(address: Address, count: int, data: bytes = b"") -> AsyncIterator[list[Attacker]]:
    """Connect so many times, and send the same over each."""
    made: list[Attacker] = []
    try:
        for _ in range(count):
            with suppress(ConnectionError):
                made.append(Attacker(*await asyncio.open_connection(*address)))
                made[-1].writer.write(data)
        yield made
    finally:
        for each in made:
            each.writer.transport.abort()


async def all_closed(found: list[Attacker]) -> None:
    async with asyncio.timeout(20):
        await asyncio.gather(*(each.until_closed() for each in found))


def connected(address: Address, count: int) -> list[socket.socket]:
    """Connect so many times and say nothing."""
    return [socket.create_connection(address, timeout=20) for _ in range(count)]


def closed_by_peer(sockets: list[socket.socket]) -> None:
    """Return when the peer has closed each; close them."""
    for each in sockets:
        with each, suppress(ConnectionError):
            assert each.recv(1) == b""


XMLRPC_HEAD: Final = b"POST / HTTP/1.1\r\nHost: x\r\n"
by_port = pytest.mark.parametrize("port", [lambda rig: rig.xmlrpc, lambda rig: rig.tcpros], ids=["XML-RPC", "TCPROS"])


@by_port
async def test_slow_loris(rig: Rig, port: Callable[[Rig], Address]) -> None:
    async with growing_at_most(rig, GROWTH_BYTES), attackers(port(rig), 100, b"\x10") as found:
        closed = asyncio.ensure_future(all_closed(found))
        while not closed.done():
            for each in found:
                if not each.writer.transport.is_closing():
                    each.writer.write(b"\x00")
            await rig.keeps_talking()
        await closed


@by_port
async def test_a_thousand_silent_connections(rig: Rig, port: Callable[[Rig], Address]) -> None:
    async with growing_at_most(rig, GROWTH_BYTES):
        silent = await asyncio.to_thread(connected, port(rig), 1000)
        await rig.keeps_talking()
        await asyncio.to_thread(closed_by_peer, silent)


@by_port
async def test_half_open_connections(rig: Rig, port: Callable[[Rig], Address]) -> None:
    async with growing_at_most(rig, GROWTH_BYTES), attackers(port(rig), 200, b"PO") as found:
        for each in found:
            with suppress(OSError):  # its time was up before this one's turn
                each.writer.write_eof()
        await all_closed(found)


FLOODS: Final = {
    "endless head": XMLRPC_HEAD + b"A: b\r\n" * 200_000,
    "endless field": XMLRPC_HEAD + b"A" * MIB,
    "endless body": XMLRPC_HEAD + b"Content-Length: 1000000\r\n\r\n" + b" " * 999_999,
    "endless chunks": XMLRPC_HEAD + b"Transfer-Encoding: chunked\r\n\r\n" + b"1\r\n \r\n" * 200_000,
    "many values": XMLRPC_HEAD + b"Content-Length: 1000000\r\n\r\n<params>" + b"<struct/>" * 111_000,
    "entities": XMLRPC_HEAD + b'Content-Length: 999\r\n\r\n<!DOCTYPE x [<!ENTITY a "aaaa">]><params>&a;</params>',
    "nesting": XMLRPC_HEAD + b"Content-Length: 999999\r\n\r\n<params>" + b"<value><array><data>" * 40_000,
}


async def test_floods_over_xmlrpc(rig: Rig) -> None:
    for what, flood in FLOODS.items():
        async with growing_at_most(rig, GROWTH_BYTES, what), attackers(rig.xmlrpc, 50, flood) as found:
            await rig.keeps_talking()
            await all_closed(found)


HEADERS: Final = {
    "4 GB": b"\xff\xff\xff\xff",
    "a megabyte less a byte": (MIB).to_bytes(4, "little") + bytes(MIB - 1),
    "fields without end": (600_000).to_bytes(4, "little") + b"\x02\x00\x00\x00a=" * 100_000,
    "requests": XMLRPC_HEAD * 10_000,
}


async def test_headers_over_tcpros(rig: Rig) -> None:
    for what, flood in HEADERS.items():
        async with growing_at_most(rig, GROWTH_BYTES, what), attackers(rig.tcpros, 50, flood) as found:
            await rig.keeps_talking()
            await all_closed(found)


MESSAGES: Final = {
    "4 GB": b"\xff\xff\xff\xff",
    "eight megabytes of which little comes": (8 * MIB).to_bytes(4, "little") + bytes(100_000),
    "eight megabytes less a byte": (8 * MIB).to_bytes(4, "little") + bytes(8 * MIB - 1),
    "texts that are none": ((4).to_bytes(4, "little") + b"\xff\xff\xff\xff") * 20_000,
}


@pytest.mark.parametrize("stream", MESSAGES.values(), ids=MESSAGES)
async def test_publishers_that_never_finish(rig: Rig, stream: bytes) -> None:
    async with AsyncExitStack() as stack:
        uris = [await stack.enter_async_context(fake_publisher(PUBLISHER + stream, hang=True)) for _ in range(12)]
        async with growing_at_most(rig, 4 * MAX_MESSAGE_BYTES):
            for number, uri in enumerate(uris):
                await rig.client.call(rig.master.uri, "registerPublisher", f"/bad{number}", "/in", STRING.name, uri)
            await rig.keeps_talking()
            await asyncio.sleep(TIMEOUT_S)
            await rig.keeps_talking()


async def test_subscribers_that_never_read(rig: Rig) -> None:
    async with growing_at_most(rig, GROWTH_BYTES), attackers(rig.tcpros, 50, SUBSCRIBER):
        await rig.keeps_talking()
        await asyncio.sleep(TIMEOUT_S)
