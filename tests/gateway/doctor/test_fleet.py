import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path

import pytest

from bus import Bus, BusError, BusSettings, QoS, open_bus
from bus.fake import FakeNetwork
from gateway.doctor.evidence import BusLook, Failure, Router, Trouble
from gateway.doctor.fleet import Join, beside_the_gateway, look_at_bus, observe
from gateway.settings import GatewaySettings
from schemas import codec, keys
from schemas.status import GatewayStatus
from tests.bus.certificates import certificate, make_certificates
from tests.contract.conftest import free_endpoint
from tests.gateway.doctor.seeing import status
from tests.integration.peers.ros import free_port
from tests.waiting import next_of

SECONDS = 0.3


@pytest.fixture
async def buses() -> AsyncIterator[tuple[Bus, Bus]]:
    """A robot's bus and the doctor's."""
    network = FakeNetwork()
    async with network.open_bus() as robots, network.open_bus() as ours:
        yield robots, ours


def settings(**changes: object) -> GatewaySettings:
    return GatewaySettings.model_validate({"robot": "r1", "ros_host": "robot", **changes})


async def speak(bus: Bus, boot_id: str, times: int, robot: str = "r1", *, key: str = "") -> None:
    """Give so many accounts, a tenth of a second of its own clock apart; key: where, if not the robot's own."""
    key = key or keys.gateway_status(robot)
    async with bus.publisher(key, QoS.STATUS, encoding=codec.encoding(GatewayStatus)) as publisher:
        for n in range(times):
            publisher.put(codec.encode(status(robot=robot, boot_id=boot_id, sent_s=n / 10)))
            await asyncio.sleep(0.01)


async def test_who_is_present_and_what_they_say(buses: tuple[Bus, Bus]) -> None:
    robots, ours = buses
    async with robots.announce(keys.robot_alive("r1")), robots.announce(keys.robot_alive("r2")):
        seen, *_ = await asyncio.gather(observe(ours, "r1", SECONDS), speak(robots, "one", 4), speak(robots, "two", 3))
    assert seen.robots == {"r1", "r2"}
    assert {each.last.boot_id: each.count for each in seen.accounts} == {"one": 4, "two": 3}
    one, two = seen.accounts
    assert one.seconds == pytest.approx(0.3)
    assert one.overlaps(two)
    assert one.skew_s < -1_000_000, "its clock starts in 1970"


async def test_without_a_name_all_robots_are_heard_each_under_its_own(buses: tuple[Bus, Bus]) -> None:
    robots, ours = buses
    async with robots.announce(keys.robot_alive("r3")):
        seen, *_ = await asyncio.gather(
            observe(ours, "", SECONDS),
            speak(robots, "one", 4),
            speak(robots, "two", 3, "r2"),
            speak(robots, "liar", 2, "r4", key=keys.gateway_status("r2")),
        )
    assert seen.robots == {"r3"}
    assert {each.last.robot: each.count for each in seen.accounts} == {"r1": 4, "r2": 3}


async def test_who_leaves_is_not_present(buses: tuple[Bus, Bus]) -> None:
    robots, ours = buses
    async with asyncio.TaskGroup() as group:
        observing = group.create_task(observe(ours, "r1", SECONDS))
        async with robots.announce(keys.robot_alive("r1")):
            await asyncio.sleep(0.05)
    assert observing.result() == BusLook()


async def test_looking_makes_no_stream_wanted(buses: tuple[Bus, Bus]) -> None:
    robots, ours = buses
    wanted: list[bool] = []
    async with (
        robots.publisher("fleet/r1/front/color", QoS.IMAGE, on_demand=wanted.append),
        robots.publisher("fleet/r1/tf", QoS.RESULT, on_demand=wanted.append),
    ):
        await observe(ours, "r1", SECONDS)
    assert wanted == []


async def test_what_is_no_account_is_not_read(buses: tuple[Bus, Bus]) -> None:
    robots, ours = buses

    async def babble() -> None:
        async with robots.publisher(keys.gateway_status("r1"), QoS.STATUS) as publisher:
            publisher.put(b"garbage")
            await asyncio.sleep(0.05)

    seen, _ = await asyncio.gather(observe(ours, "r1", SECONDS), babble())
    assert seen.accounts == ()


async def test_without_a_router_the_bus_is_not_opened() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    seen = await look_at_bus(settings(connect=[endpoint]), seconds=60, patience_s=5)
    assert [(router.endpoint, router.trouble is None) for router in seen.routers] == [(endpoint, False)]


def refusing(_: BusSettings) -> AbstractAsyncContextManager[Bus]:
    raise BusError("no such certificate")


@asynccontextmanager
async def hanging(_: BusSettings) -> AsyncIterator[Bus]:
    async with FakeNetwork().open_bus() as bus:
        await asyncio.Event().wait()
        yield bus


@pytest.mark.parametrize(("join", "reason"), [(refusing, "no such certificate"), (hanging, "it takes too long")])
async def test_a_bus_that_cannot_be_joined(join: Join, reason: str) -> None:
    endpoint = "udp/127.0.0.1:7447"
    seen = await look_at_bus(settings(connect=[endpoint]), seconds=0.05, patience_s=0.05, join=join)
    assert seen == BusLook((Router(endpoint, Trouble(Failure.REFUSED, "", 0, reason)),))


async def test_a_bus_that_is_joined() -> None:
    network = FakeNetwork()
    async with network.open_bus() as robots, robots.announce(keys.robot_alive("r1")):
        endpoint = "udp/127.0.0.1:7447"
        look = look_at_bus(settings(connect=[endpoint]), seconds=0.1, patience_s=5, join=lambda _: network.open_bus())
        assert await look == BusLook((Router(endpoint),), frozenset({"r1"}))


@pytest.mark.parametrize(
    ("given", "mode", "connect"),
    [
        ({"connect": ["tcp/a:1"]}, "client", [["tcp/a:1"]]),
        ({"mode": "peer", "connect": ["tcp/a:1"], "listen": ["tcp/b:2"]}, "peer", [["tcp/a:1", "tcp/b:2"]]),
        ({"mode": "router", "connect": ["tcp/a:1"], "listen": ["tcp/b:2"]}, "client", [["tcp/a:1"], ["tcp/b:2"]]),
        ({"connect": ["tcp/a:1"], "listen": ["tcp/b:2"]}, "client", [["tcp/a:1"], ["tcp/b:2"]]),
        (
            {"mode": "router", "listen": ["tcp/0.0.0.0:7447", "tcp/[::]:7448"]},
            "client",
            [["tcp/127.0.0.1:7447", "tcp/127.0.0.1:7448"]],
        ),
        ({"mode": "peer", "connect": ["tcp/a:1"], "listen": ["tcp/b:0"]}, "peer", [["tcp/a:1"]]),
    ],
)
def test_how_it_joins_next_to_the_gateway(given: dict[str, object], mode: str, connect: list[list[str]]) -> None:
    ways = beside_the_gateway(settings(**given))
    assert [(joining.mode, joining.connect, joining.listen) for joining in ways] == [
        (mode, each, []) for each in connect
    ]


def test_it_has_the_gateways_certificate() -> None:
    files = {"tls_ca": Path(__file__), "tls_certificate": Path(__file__), "tls_key": Path(__file__)}
    (joining,) = beside_the_gateway(settings(connect=["tls/central:7447"], **files))
    assert joining.model_dump(include=set(files)) == files


async def test_a_gateway_that_listens_with_a_certificate_is_found_beside_it(tmp_path: Path) -> None:
    make_certificates(tmp_path / "fleet")
    own = free_endpoint().replace("tcp/127.0.0.1", "tls/0.0.0.0")
    gateway = settings(mode="router", listen=[own], insecure=True, **certificate(tmp_path / "fleet", "r1"))
    async with open_bus(gateway) as bus, bus.announce(keys.robot_alive("r1")):
        seen = await look_at_bus(gateway, seconds=1, patience_s=5)
    assert seen.robots == {"r1"}
    assert [router.trouble for router in seen.routers] == [None]


@pytest.mark.parametrize("linked", [True, False])
async def test_a_gateway_without_a_link_to_the_centre_is_found_at_home(*, linked: bool) -> None:
    centre, robot = free_endpoint(), free_endpoint()
    of_gateway = settings(mode="router", listen=[robot], connect=[centre])
    gateway = of_gateway if linked else of_gateway.model_copy(update={"connect": []})
    async with (
        open_bus(BusSettings(mode="router", listen=[centre])) as bus,
        bus.watch(keys.robot_alive("r1")) as present,
        open_bus(gateway) as ours,
        ours.announce(keys.robot_alive("r1")),
    ):
        if linked:
            await next_of(present)
        seen = await look_at_bus(of_gateway, seconds=0.5, patience_s=5)
    assert seen == BusLook((Router(centre), Router(robot)), frozenset({"r1"}), at_home_only=not linked)


async def hang_up(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    writer.close()


@pytest.mark.parametrize(("protocol", "failure"), [("tcp", Failure.FOREIGN), ("udp", Failure.SILENT)])
async def test_what_speaks_no_zenoh_cannot_be_joined(protocol: str, failure: Failure) -> None:
    async with await asyncio.start_server(hang_up, "127.0.0.1", 0) as server:
        endpoint = f"{protocol}/127.0.0.1:{server.sockets[0].getsockname()[1]}"
        seen = await look_at_bus(settings(connect=[endpoint]), seconds=0.1, patience_s=2)
    assert seen == BusLook((Router(endpoint, Trouble(failure, "", 0)),))


async def test_a_gateway_whose_port_nobody_knows_is_not_sought_there() -> None:
    gateway = settings(mode="router", listen=["tcp/127.0.0.1:0"])
    assert await look_at_bus(gateway, seconds=60, patience_s=5) == BusLook()
