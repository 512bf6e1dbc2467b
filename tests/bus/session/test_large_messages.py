"""The largest messages, those that are larger, and those of which only a part comes."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

import pytest
import zenoh

from bus import MAX_PAYLOAD_BYTES, QUEUE, BusError, BusSettings, QoS, open_bus
from bus.session.config import MAX_MESSAGE_BYTES, session_config
from schemas import codec
from schemas.image import ImageFrame
from schemas.points import PointCloud
from tests.bus.sessions import LEASE_S, ROUTER, client, router, running
from tests.contract.conftest import free_endpoint
from tests.waiting import PATIENCE_S, until

MIB: Final = 1 << 20
FOUR_K: Final = 3840 * 2160 * 4
KEY: Final = "fleet/r1/front/color"
KEEP_ALIVE: Final = b"\x01\x00\x04"
FRAGMENT: Final = 0x06
MORE: Final = 0x40
EXTENDED: Final = 0x80


@pytest.mark.parametrize("size", [FOUR_K, MAX_PAYLOAD_BYTES], ids=["4K", "the largest"])
async def test_large_images_and_clouds_arrive(size: int) -> None:
    endpoint = free_endpoint()
    async with (
        open_bus(router(endpoint).model_copy(update={"shared_memory": False})) as centre,
        centre.subscribe(KEY, QUEUE(1)) as heard,
        open_bus(client(endpoint).model_copy(update={"shared_memory": False})) as robot,
        robot.publisher(KEY, QoS.IMAGE) as images,
    ):
        await until(lambda: images.wanted)
        arriving = asyncio.ensure_future(anext(heard))
        async with asyncio.timeout(PATIENCE_S):
            while not arriving.done():  # a busy machine may drop one
                images.put(bytes(size))
                await asyncio.wait([arriving], timeout=5)
        assert len(arriving.result().payload) == size


def test_the_largest_message_is_the_largest_image_or_cloud() -> None:
    assert codec.MAX_BYTES[ImageFrame] == codec.MAX_BYTES[PointCloud] == MAX_PAYLOAD_BYTES
    config = zenoh.Config.from_json5(json.dumps(session_config(BusSettings())))
    assert json.loads(config.get_json("transport/link/rx/max_message_size")) == MAX_MESSAGE_BYTES


async def test_a_larger_message_is_refused_by_its_sender() -> None:
    endpoint = free_endpoint()
    async with open_bus(router(endpoint)) as bus, bus.publisher(KEY, QoS.IMAGE) as images:
        with pytest.raises(BusError, match=f"^{KEY}: a message of {MAX_PAYLOAD_BYTES + 1} bytes, at most"):
            images.put(bytes(MAX_PAYLOAD_BYTES + 1))
        assert images.counts.put == 0


class HalfSender:
    """Stands between a client and a router, and makes the client's first large message one that never ends.

    sent: bytes of fragments. ended: whether the router has closed the link.
    """

    def __init__(self, endpoint: str) -> None:
        self.sent = 0
        self.ended = asyncio.Event()
        self._host, _, self._port = endpoint.removeprefix("tcp/").partition(":")
        self._limit = 0
        self._more = asyncio.Event()

    def send_until(self, sent: int) -> None:
        """Send fragments up to so many bytes, of all."""
        self._limit = sent
        self._more.set()

    @contextlib.asynccontextmanager
    async def between(self) -> AsyncIterator[str]:
        """Listen; yields the endpoint for the client."""
        tasks: set[asyncio.Task[None]] = set()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            tasks.add(asyncio.current_task())  # type: ignore[arg-type]
            back_reader, back = await asyncio.open_connection(self._host, self._port)
            down = asyncio.create_task(_pass_on(back_reader, writer))
            try:
                await self._up(reader, back, down)
            except (OSError, asyncio.IncompleteReadError):
                pass
            finally:
                down.cancel()
                back.close()
                writer.close()

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        try:
            yield f"tcp/127.0.0.1:{server.sockets[0].getsockname()[1]}"
        finally:
            server.close()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _up(self, reader: asyncio.StreamReader, back: asyncio.StreamWriter, down: asyncio.Task[None]) -> None:
        fragments = 0
        while True:
            size = await reader.readexactly(2)
            batch = await reader.readexactly(int.from_bytes(size, "little"))
            if batch[0] & 0x1F == FRAGMENT:
                fragments += 1
            if fragments == 2:  # the first one tells that it is the first
                return await self._go_on(batch, back, down)
            back.write(size + batch)

    async def _go_on(self, like: bytes, back: asyncio.StreamWriter, down: asyncio.Task[None]) -> None:
        number, at = _read_number(like, 1)
        extensions = b""
        if like[0] & EXTENDED:  # the priority: an extension with a number
            _, end = _read_number(like, at + 1)
            assert not like[at] & EXTENDED, "one extension"
            extensions = like[at:end]
        rest = bytes(len(like) - 32)
        while not down.done():
            if self.sent >= self._limit:
                self._more.clear()
                back.write(KEEP_ALIVE)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._more.wait(), LEASE_S / 4)
                continue
            batch = bytes([like[0] | MORE]) + _number(number) + extensions + rest
            number, self.sent = number + 1, self.sent + len(rest)
            back.write(len(batch).to_bytes(2, "little") + batch)
            try:
                await back.drain()
            except ConnectionError:
                break
        self.ended.set()


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(ConnectionError):
        while data := await reader.read(1 << 16):
            writer.write(data)


def _read_number(data: bytes, at: int) -> tuple[int, int]:
    """Return a number of seven bits a byte, and where the next thing is."""
    value = shift = 0
    while data[at] & 0x80:
        value, shift, at = value | (data[at] & 0x7F) << shift, shift + 7, at + 1
    return value | data[at] << shift, at + 1


def _number(value: int) -> bytes:
    made = bytearray()
    while value > 0x7F:
        made.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*made, value])


def memory_of(process: asyncio.subprocess.Process) -> int:
    """Return the resident bytes of a process."""
    return int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * 4096


async def test_of_a_message_that_never_ends_a_router_holds_no_more_than_the_largest() -> None:
    endpoint = free_endpoint()
    half = HalfSender(endpoint)
    async with (
        running(ROUTER, endpoint, str(LEASE_S)) as process,
        half.between() as there,
        open_bus(client(endpoint)) as listener,
        listener.subscribe("fleet/**", QUEUE(9)) as heard,
    ):
        config = session_config(BusSettings(connect=[there], lease_s=LEASE_S, shared_memory=False))
        attacker = await asyncio.to_thread(zenoh.open, zenoh.Config.from_json5(json.dumps(config)))
        try:
            publisher = attacker.declare_publisher(KEY)
            await until(lambda: publisher.matching_status)
            before = memory_of(process)
            await asyncio.to_thread(publisher.put, bytes(MIB))
            half.send_until(100 * MIB)
            await until(lambda: half.sent >= 100 * MIB)
            await asyncio.sleep(2 * LEASE_S)
            assert not half.ended.is_set(), "what is held is held for as long as the link lives"
            assert memory_of(process) - before > 90 * MIB
            half.send_until(4 * MAX_MESSAGE_BYTES)
            highest = 0
            while half.sent < 4 * MAX_MESSAGE_BYTES:
                highest = max(highest, memory_of(process))
                await asyncio.sleep(0.01)
            assert not half.ended.is_set(), "all was received"
            assert highest - before < 1.2 * MAX_MESSAGE_BYTES
        finally:
            await asyncio.to_thread(attacker.close)
        async with open_bus(client(endpoint)) as other, other.publisher(KEY, QoS.RESULT) as results:
            results.put(b"served")
            assert (await asyncio.wait_for(anext(heard), PATIENCE_S)).payload == b"served"
