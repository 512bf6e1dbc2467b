"""Robots' gateways as their router sees them. Arguments: router, number of the first robot, `alone` or `beside`.

Each is a Zenoh session of its own. It declares what a gateway of one camera with depth and points, a lidar and
transforms declares, one to which services beside the robot connect or one without, and sends one status; no images
flow, and nothing of ROS is there. All of them listen, since Zenoh then makes a lost link again by itself: that a
gateway without services opens a new session instead costs a processor of its own, of which a thousand are not here.

Obeys `robots N`: from then on there are so many. Says how many there are, and how many have a link.
"""

import asyncio
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final

import zenoh

from benchmarks.peers.answering import obey
from bus import QUEUE, BusSettings, QoS, Reply, Request
from bus.delivery.subscription import ZenohSubscription
from bus.demand import Demand
from bus.history.keeping import CacheServer
from bus.presence.listed_tokens import ListedTokens, ZenohWatch
from bus.presence.own_tokens import OwnTokens, ZenohToken
from bus.session.config import session_config
from bus.session.declaration import Declaration
from bus.session.publishers_and_servers import Lanes, ZenohPublisher, ZenohServer
from gateway.to_bus.translators import StreamKind, kind_of
from schemas import codec, consumer_keys, keys
from schemas.status import GatewayStatus

STREAMS: Final = (
    *(f"front/{stream}" for stream in ("color", "depth", "info", "depth_info", "points")),
    "lidar/points",
    "tf",
    "tf_static",
)
STATUS: Final = b"x" * 2_000
"""Of the size of a status."""

SETTLING_S: Final = 10.0
"""Longest wait for the router to take what a robot declares, before the next one comes."""


class Fleet:
    """The robots of this process."""

    def __init__(self, router: str, first: int, kind: str) -> None:
        self._settings = BusSettings(connect=[router], listen=["tcp/127.0.0.1:0"], shared_memory=False)
        self._first = first
        self._kind = kind
        self._loop = asyncio.get_running_loop()
        self._lanes = Lanes()
        self._sessions: list[zenoh.Session] = []
        self._kept: list[Declaration] = []

    def obey(self, line: str) -> Mapping[str, object]:
        """Do what a line says."""
        match line.split():
            case ["robots", number]:
                while len(self._sessions) < int(number):
                    self._come(f"r{self._first + len(self._sessions)}")
            case []:
                pass
            case _:
                raise ValueError(f"cannot do {line!r}")
        return {"robots": len(self._sessions), "linked": sum(bool(each.info.links()) for each in self._sessions)}

    def _come(self, robot: str) -> None:
        prefix = keys.robot_prefix(robot)
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(self._config(prefix))))
        last: list[Callable[[], None]] = []
        tokens = OwnTokens(prefix, lambda _, call: last.append(call))
        caches = CacheServer(prefix, tokens)
        publisher = partial(self._publisher, caches)
        status = publisher(keys.gateway_status(robot), QoS.STATUS, codec.encoding(GatewayStatus))
        declarations: list[Declaration] = [
            tokens,
            caches,
            *(publisher(str(key), kind.qos, kind.encoding) for key, kind in _streams(robot)),
            *(ZenohToken(key.alive, tokens) for key, _ in _streams(robot)),
            *self._requests(robot),
            status,
            ZenohToken(keys.robot_alive(robot), tokens),
        ]
        for each in declarations:
            each.declare(session)
            self._kept.append(each)
        status.put(STATUS)
        for call in (lambda: None, *last):  # who has the status live by then need not ask for it
            call()
            for _ in session.liveliness().get("nobody", timeout=SETTLING_S):
                pass
        self._sessions.append(session)

    def _config(self, prefix: str) -> dict[str, Any]:
        config = session_config(self._settings, prefix=prefix)
        if self._kind == "beside":
            return config
        alone = session_config(self._settings.model_copy(update={"listen": []}), prefix=prefix)
        return config | {"aggregation": alone["aggregation"]}

    def _requests(self, robot: str) -> Iterator[Declaration]:
        for answered in (keys.robot_clock(robot), keys.every_service(robot)):
            yield ZenohServer(answered, _answer, _now, 1, 16)
        yield ZenohWatch(
            consumer_keys.every_wanted(robot),
            self._loop,
            ListedTokens(keys.robot_prefix(robot), lambda *_: None),
            few=True,
        )
        for heard in (consumer_keys.every_budget(robot), f"fleet/{robot}/{keys.ACTIONS}"):
            yield ZenohSubscription(heard, QUEUE(1), self._loop, few=True)

    def _publisher(self, caches: CacheServer, key: str, qos: QoS, encoding: str) -> ZenohPublisher:
        demand = Demand(self._loop, None)
        return ZenohPublisher(key, qos, encoding, demand, self._lanes, caches=caches, kept=1, shared_memory=False)


def _streams(robot: str) -> list[tuple[keys.SensorKey, StreamKind]]:
    found = [keys.sensor_key(robot, name) for name in STREAMS]
    return [(key, kind_of(key)) for key in found]


def _now(act: Callable[[], object]) -> None:
    act()


async def _answer(request: Request) -> Reply:
    return Reply(request.payload)


async def run(router: str, first: int, kind: str) -> None:
    """Obey until the standard input ends."""
    fleet = Fleet(router, first, kind)
    obey(fleet.obey)  # nothing is asked of these robots that would need the event loop


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1], int(sys.argv[2]), sys.argv[3]))
    os._exit(0)  # closing all sessions one by one takes minutes
