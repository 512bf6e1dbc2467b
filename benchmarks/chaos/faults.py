"""The faults: how each begins, how long it lasts, and how it ends."""

import asyncio
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Final

from benchmarks.chaos import clock, system
from benchmarks.chaos.database import fill, make_room
from benchmarks.chaos.observer import FRONT
from benchmarks.chaos.system import ROUTER, UNIT_RESTART_S, System
from bus import BusSettings
from bus.settings import port_of
from services.access.authority import Authority

HANGS_S: Final = 3 * BusSettings().lease_s
GONE_S: Final = 30.0
POOR_S: Final = 15.0
FULL_S: Final = 10.0
TAKEN_S: Final = 22.0
"""By then a session has noticed that its certificate was renewed: it looks every 10 s, and twice."""

EXPIRES_S: Final = 25.0
HOUR_S: Final = 3_600
STEPPED_S: Final = 8.0
NS: Final = 1_000_000_000
DAY_S: Final = 86_400

THIN: Final = "2 Mbit/s"
KILLED: Final = (
    system.GATEWAY,
    system.DETECTOR,
    system.DISTANCE,
    system.CLOUD,
    system.WORLD,
    system.MONITOR,
    system.ROUTER,
    system.MASTER,
    system.POSTGRESQL,
)
RESTARTED: Final = (system.ROUTER, system.MASTER)


class Needs(StrEnum):
    """The fleet that a fault needs: faults of one kind follow each other on the same fleet."""

    NOTHING = "processes"
    NETWORK = "a network namespace"
    DISK = "a disk of its own"
    CLOCK = "a clock that can be stepped"
    CERTIFICATES = "certificates"


Act = Callable[[System], Any]


def nothing(_: System) -> None:
    """Do nothing."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault. hold_s: how long it lasts, from begin to end. lasts_s: how long its effects are looked at beyond that.

    before: what it takes, of a fleet that is then well again. after: what is undone once its cost is known.

    images: whether a viewer at the centre wants the camera's images meanwhile.
    """

    name: str
    begin: Act
    hold_s: float
    end: Act = nothing
    before: Act = nothing
    after: Act = nothing
    role: str = ""
    needs: Needs = Needs.NOTHING
    images: bool = False
    lasts_s: float = 0.0

    async def hold(self, fleet: System) -> None:
        """Have the fault for as long as it lasts."""
        self.begin(fleet)
        try:
            await asyncio.sleep(self.hold_s)
        finally:
            self.end(fleet)


def faults() -> Iterator[Fault]:
    """Yield all faults, in an order in which each finds a fleet that is well."""
    for role in KILLED:
        yield Fault(f"SIGKILL {role}", _kill(role), UNIT_RESTART_S, _start(role), role=role)
        yield Fault(f"SIGSTOP {role}", _stop(role), HANGS_S, _go_on(role), role=role)
    for role in RESTARTED:
        yield Fault(f"restart {role}", _end(role), UNIT_RESTART_S, _start(role), role=role)
    yield from _of_the_network()
    full = Fault("full disk", lambda fleet: fill(fleet.disk), FULL_S, lambda fleet: make_room(fleet.disk))
    yield _needing(full, Needs.DISK)
    for name, hours in (("clock an hour ahead", 1), ("clock an hour back", 0), ("clock an hour behind", -1)):
        yield _needing(Fault(name, _step(hours * HOUR_S), 0.0, lasts_s=STEPPED_S), Needs.CLOCK)
    yield _needing(Fault("certificate renewed", _renew(DAY_S), TAKEN_S), Needs.CERTIFICATES)
    yield _needing(Fault("a robot more in the access rules", _admit, TAKEN_S), Needs.CERTIFICATES)
    expired_s = EXPIRES_S + HANGS_S
    yield _needing(Fault("certificate expired", _renew(EXPIRES_S), expired_s, _renew(DAY_S)), Needs.CERTIFICATES)


def named(names: Iterable[str]) -> list[Fault]:
    """Return the faults of these names, all if there are none.

    Raises:
        ValueError: there is no such fault.
    """
    known = {fault.name: fault for fault in faults()}
    wanted = list(names) or list(known)
    for name in wanted:
        if name not in known:
            raise ValueError(f"no fault is called {name!r}; there are {', '.join(known)}")
    return [known[name] for name in wanted]


def _of_the_network() -> Iterator[Fault]:
    poor = {
        THIN: {"mbit": 2.0},
        "10 % loss": {"loss": 0.1},
        "100 +- 50 ms": {"delay_ms": 100.0, "jitter_ms": 50.0},
    }
    yield _needing(Fault("no network", _link(up=False), GONE_S, _link()), Needs.NETWORK)
    for name, conditions in poor.items():
        made = Fault(name, _link(**conditions), POOR_S, _link(), images=True)
        yield _needing(made, Needs.NETWORK)
    roaming = Fault("roaming to another router", _roam, 0.0, before=_return, after=_return, role=ROUTER)
    yield _needing(roaming, Needs.NETWORK)


def _needing(fault: Fault, needs: Needs) -> Fault:
    return replace(fault, needs=needs)


def _kill(role: str) -> Act:
    return lambda fleet: fleet.kill(role)


def _end(role: str) -> Act:
    return lambda fleet: fleet.end(role)


def _start(role: str) -> Act:
    return lambda fleet: fleet.start(role)


def _stop(role: str) -> Act:
    return lambda fleet: fleet.stop(role)


def _go_on(role: str) -> Act:
    return lambda fleet: fleet.go_on(role)


def _link(**conditions: object) -> Act:
    def change(fleet: System) -> None:
        assert fleet.place.network is not None  # noqa: S101 - faults that need one are not begun without
        fleet.place.network.set(**conditions)

    return change


def _roam(fleet: System) -> None:
    """The router that the robot is linked to can be reached no more; another one can."""
    _link(blocked=int(port_of(fleet.endpoints[0])))(fleet)


def _return(fleet: System) -> None:
    """The gateway begins anew at the first router."""
    _link()(fleet)
    fleet.end(system.GATEWAY)
    fleet.start(system.GATEWAY)


def _admit(fleet: System) -> None:
    """Routers read rules as they open a session: all their links end."""
    fleet.place.admit(FRONT.robot, "another")


def _step(seconds: int) -> Act:
    def set_clock(fleet: System) -> None:
        fleet.ahead_ns = seconds * NS
        clock.step(fleet.place.folder, fleet.ahead_ns)

    return set_clock


def _renew(good_for_s: float) -> Act:
    def renew(fleet: System) -> None:
        assert fleet.place.pki is not None  # noqa: S101 - as above
        Authority(fleet.place.pki).renew("r1", good_for_s / DAY_S)

    return renew
