from __future__ import annotations

import asyncio
import gc
import socket
import threading
from typing import TYPE_CHECKING, Any

import pytest

from gateway.ros1 import resolver
from gateway.ros1.errors import UnreachableError
from gateway.ros1.master import MasterClient
from gateway.ros1.resolver import Resolver
from gateway.ros1.tcpros.service_client import ServiceClient
from gateway.ros1.wire.tcpros import TopicType
from gateway.ros1.wire.xmlrpc import MethodResponse, encode
from gateway.ros1.xmlrpc.client import XmlRpcClient
from services.simulator.ros_master.master import RosMaster
from tests.gateway.ros1.xmlrpc.test_xmlrpc_client import ok, peer
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import Iterator


class Names:
    """What the system's lookup answers: a name that is in neither takes until `give_up` is set."""

    def __init__(self, known: dict[str, list[str]]) -> None:
        self.known = known
        self.asked: list[str] = []
        self.give_up = threading.Event()

    def look_up(self, host: str, *_: Any, **__: Any) -> list[tuple[Any, ...]]:
        self.asked.append(host)
        if host not in self.known:
            self.give_up.wait()
            raise socket.gaierror(f"{host} is not known")
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, 0)) for address in self.known[host]]


@pytest.fixture
def names(monkeypatch: pytest.MonkeyPatch) -> Iterator[Names]:
    made = Names({"robot": ["127.0.0.2", "127.0.0.1", "127.0.0.1"]})
    monkeypatch.setattr(socket, "getaddrinfo", made.look_up)
    yield made
    made.give_up.set()


async def echo(address: str) -> str:
    return address


async def refusing(address: str) -> str:
    if address != "127.0.0.1":
        raise ConnectionRefusedError(address)
    return address


async def unreachable(address: str) -> str:
    raise ConnectionRefusedError(address)


async def silent_but_for_the_last(address: str) -> str:
    if address != "127.0.0.1":
        await asyncio.Event().wait()
    return address


async def silent_and_refusing(address: str) -> str:
    return await unreachable(await silent_but_for_the_last(address))


async def test_names_that_are_looked_up_for_long_keep_nobody_from_being_called(names: Names) -> None:
    async with peer(ok(encode(MethodResponse([1, "", "value"])))) as uri, XmlRpcClient(timeout=60) as client:
        lost = [asyncio.create_task(client.call(f"http://lost{n % 20}:1/", "getPid", "/a")) for n in range(40)]
        await until(lambda: len(names.asked) == 20, "each of them is looked up once")
        assert await client.call(uri.replace("127.0.0.1", "robot"), "getUri", "/a") == "value"
        names.give_up.set()
        failed = await asyncio.gather(*lost, return_exceptions=True)
    assert {type(error) for error in failed} == {UnreachableError}
    assert "lost3 is not known" in str(failed[3])


async def test_addresses_are_tried_in_turn_and_each_once(names: Names) -> None:
    found = Resolver()
    assert await found.connect("robot", echo) == "127.0.0.2"
    assert await found.connect("robot", refusing) == "127.0.0.1"
    with pytest.raises(ConnectionRefusedError, match=r"127\.0\.0\.2"):
        await found.connect("robot", unreachable)
    assert names.asked == ["robot"] * 3


async def test_a_refusal_by_one_address_says_nothing_of_a_host_that_cannot_be_reached_at_another(names: Names) -> None:
    async def refusing_or_lost(address: str) -> str:
        if address == names.known["robot"][0]:
            raise ConnectionRefusedError(address)
        raise OSError(f"no route to {address}")

    with pytest.raises(OSError, match="no route to"):
        await Resolver().connect("robot", refusing_or_lost)


async def test_an_address_that_keeps_silent_leaves_time_for_the_next(
    names: Names, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resolver, "LOOKUP_TIMEOUT_S", 0.01)
    assert names.known["robot"][0] != "127.0.0.1"
    async with asyncio.timeout(60):
        assert await Resolver().connect("robot", silent_but_for_the_last) == "127.0.0.1"
        with pytest.raises(OSError, match=r"no answer from 127\.0\.0\.2"):
            await Resolver().connect("robot", silent_and_refusing)


async def test_the_last_address_has_all_the_time_that_there_is(names: Names, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resolver, "LOOKUP_TIMEOUT_S", 0.0)

    async def slow(address: str) -> str:
        await asyncio.sleep(0.05)
        return address

    assert await Resolver().connect("robot", slow) == "127.0.0.1"
    assert names.asked == ["robot"]


@pytest.mark.parametrize("address", ["127.0.0.1", "::1"])
async def test_an_address_is_not_looked_up(names: Names, address: str) -> None:
    assert await Resolver().connect(address, echo) == address
    assert names.asked == []


async def test_who_waits_no_longer_takes_the_answer_from_nobody(names: Names) -> None:
    found = Resolver()
    leaving, staying = (asyncio.create_task(found.connect("lost", echo)) for _ in range(2))
    await until(lambda: names.asked, "it is looked up")
    leaving.cancel()
    await asyncio.wait([leaving])
    names.give_up.set()
    with pytest.raises(socket.gaierror, match="lost is not known"):
        await staying


async def test_a_name_for_whose_answer_nobody_waits_any_longer_says_nothing_in_the_log(
    names: Names, caplog: pytest.LogCaptureFixture
) -> None:
    found = Resolver()
    leaving = asyncio.create_task(found.connect("lost", echo))
    await until(lambda: names.asked, "it is looked up")
    leaving.cancel()
    await asyncio.wait([leaving])
    names.give_up.set()
    await until(lambda: not found._under_way, "the answer is there")
    gc.collect()
    assert caplog.messages == []


async def test_no_more_than_so_many_are_looked_up_at_a_time(names: Names, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resolver, "MAX_LOOKUPS", 1)
    found = Resolver()
    first = asyncio.create_task(found.connect("lost", echo))
    await until(lambda: names.asked, "it is looked up")
    with pytest.raises(OSError, match="robot: 1 other names are being looked up"):
        await found.connect("robot", echo)
    names.give_up.set()
    await asyncio.wait([first])
    assert first.exception() is not None
    assert await found.connect("robot", echo) == "127.0.0.2"


async def test_services_on_machines_that_nobody_knows_keep_no_thread_of_asyncios(names: Names) -> None:
    async with RosMaster() as ros_master, XmlRpcClient() as client:
        master = MasterClient(client, uri=ros_master.uri, caller_id="/arm")
        for n in range(40):
            await master.call("registerService", f"/stop{n}", f"rosrpc://lost{n}:1", "http://127.0.0.1:9/")
        ours = ServiceClient(master)
        calls = [
            asyncio.create_task(ours.call(f"/stop{n}", TopicType("*", "*"), lambda _: b"", timeout_s=60))
            for n in range(40)
        ]
        await until(lambda: len(names.asked) == 40, "all of them are looked up")
        assert await asyncio.to_thread(int) == 0
        names.give_up.set()
        failed = await asyncio.gather(*calls, return_exceptions=True)
    assert {type(error) for error in failed} == {UnreachableError}
