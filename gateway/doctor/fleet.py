"""Examines the bus: routers, presence and gateways' statuses. It subscribes to no stream."""

import asyncio
import time
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, suppress
from dataclasses import replace
from typing import Final

from bus import QUEUE, Bus, BusError, BusSettings, open_bus
from bus.clocks import clock_id
from bus.settings import port_of
from gateway.doctor.evidence import BusLook, Failure, GatewayReport, Router, Trouble
from gateway.doctor.reachability import can_be_tried, look_at_router
from gateway.settings import GatewaySettings
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.status import GatewayStatus

MAX_ACCOUNTS: Final = 16
MAX_ROBOTS: Final = 10_000
STATUSES_WAITING: Final = QUEUE(1_000, 16 << 20)


Join = Callable[[BusSettings], AbstractAsyncContextManager[Bus]]


async def look_at_bus(
    settings: GatewaySettings, *, seconds: float, patience_s: float, join: Join = open_bus
) -> BusLook:
    """Observe the bus for some seconds; joining it may take twice `patience_s`.

    Without a robot's name the whole fleet is looked at. A gateway that connects and listens is looked for
    among those, and at home.
    """
    looks = await asyncio.gather(
        *(
            _look(settings.robot, joining, seconds=seconds, patience_s=patience_s, join=join)
            for joining in beside_the_gateway(settings)
        )
    )
    first = looks[0] if looks else BusLook()
    seen = next((look for look in looks if _has(look, settings.robot)), first)
    routers = tuple(router for look in looks for router in look.routers)
    return replace(seen, routers=routers, at_home_only=seen is not first)


def _has(look: BusLook, robot: str) -> bool:
    """Return whether the robot, or with an empty name any robot, is present."""
    return bool(look.accounts) or (robot in look.robots if robot else bool(look.robots))


async def _look(robot: str, joining: BusSettings, *, seconds: float, patience_s: float, join: Join) -> BusLook:
    routers = tuple(await asyncio.gather(*(look_at_router(endpoint, patience_s) for endpoint in joining.connect)))
    if routers and all(router.trouble for router in routers) and not joining.scouting:
        return BusLook(routers)
    try:
        async with asyncio.timeout(seconds + 2 * patience_s), join(joining) as bus:
            look = await observe(bus, robot, seconds)
            if not bus.link_problem:
                return replace(look, routers=routers)
    except (BusError, TimeoutError) as error:
        refused = Trouble(Failure.REFUSED, "", 0, str(error) or "it takes too long")
        return BusLook(tuple(replace(router, trouble=router.trouble or refused) for router in routers))
    return replace(
        look, routers=tuple(replace(router, trouble=router.trouble or _unlinked(router)) for router in routers)
    )


def _unlinked(router: Router) -> Trouble:
    """Return the router's state for an endpoint that has no link for no other known reason."""
    return Trouble(Failure.FOREIGN if can_be_tried(router.endpoint) else Failure.SILENT, "", 0)


async def observe(bus: Bus, robot: str, seconds: float) -> BusLook:
    """Return the robots present on the bus, and the statuses of the robot's gateways, or of all."""
    robots: set[str] = set()
    accounts: dict[str, GatewayReport] = {}
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            await asyncio.gather(_watch(bus, robots), _read(bus, robot, accounts))
    return BusLook((), frozenset(robots), tuple(accounts.values()))


def beside_the_gateway(settings: GatewaySettings) -> list[BusSettings]:
    """Return bus settings that connect to the gateway's listen endpoints, since those are in use.

    A listener on every address is reachable at 127.0.0.1 too, which certificates can name: Zenoh (1.10) finds no [::1]
    in them.
    A client uses the first endpoint that answers, so the endpoints that a gateway connects to, and those at which it
    listens, are two ways to join.
    """
    own = [
        endpoint.replace("0.0.0.0", "127.0.0.1").replace("[::]", "127.0.0.1")  # noqa: S104
        for endpoint in settings.listen
        if port_of(endpoint) != "0"  # the system chose the port
    ]
    ways = [settings.connect, own] if settings.listen and settings.mode != "peer" else [[*settings.connect, *own]]
    return [
        BusSettings(
            mode="peer" if settings.mode == "peer" else "client",
            connect=connect,
            scouting=settings.scouting,
            shared_memory=False,
            lease_s=settings.lease_s,
            tls_ca=settings.tls_ca,
            tls_certificate=settings.tls_certificate,
            tls_key=settings.tls_key,
        )
        for connect in ways
        if connect or settings.scouting
    ]


async def _watch(bus: Bus, robots: set[str]) -> None:
    async with bus.watch(keys.EVERY_ROBOT_ALIVE) as watch:
        async for presence in watch:
            with suppress(SchemaError):
                robot = keys.parse_robot(presence.key)
                if not presence.alive:
                    robots.discard(robot)
                elif len(robots) < MAX_ROBOTS:
                    robots.add(robot)


async def _read(bus: Bus, robot: str, accounts: dict[str, GatewayReport]) -> None:
    same_clock = clock_id()
    key = keys.gateway_status(robot) if robot else keys.EVERY_GATEWAY_STATUS
    most = MAX_ACCOUNTS if robot else MAX_ROBOTS
    async with bus.subscribe(key, STATUSES_WAITING) as samples:
        async for sample in samples:
            with suppress(SchemaError):
                status = codec.decode(GatewayStatus, sample.payload, sample.encoding)
                if status.robot != keys.parse_robot(sample.key):
                    continue
                skew_s = 0.0 if status.clock_id == same_clock else (status.sent_ns - sample.received_ns) / 1e9
                _note(accounts, most, status, skew_s, time.monotonic())


def _note(accounts: dict[str, GatewayReport], most: int, status: GatewayStatus, skew_s: float, now_s: float) -> None:
    known = accounts.get(status.boot_id)
    if known is not None:
        accounts[status.boot_id] = replace(known, last=status, count=known.count + 1, skew_s=skew_s, until_s=now_s)
    elif len(accounts) < most:
        accounts[status.boot_id] = GatewayReport(status, status, 1, skew_s, since_s=now_s, until_s=now_s)
