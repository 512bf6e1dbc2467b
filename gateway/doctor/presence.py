"""Checks the bus: routers, the robot's gateway and its status. Pure."""

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final

from bus.settings import port_of
from gateway.doctor.evidence import BusLook, Evidence, Failure, GatewayReport, Trouble
from gateway.doctor.finding import Finding, Stage, fine, note, problem

SKEW_S: Final = 1.0


def check_presence(evidence: Evidence) -> Iterator[Finding]:
    """Check that the robot's gateway is on the bus, and the only one of its name."""
    bus, robot = evidence.bus, evidence.robot
    yield from _check_routers(bus)
    if _cut_off(bus):
        return
    if robot not in bus.robots and not bus.accounts:
        yield _absent(robot, bus.robots)
        return
    if bus.at_home_only:
        yield problem(
            Stage.GATEWAY,
            robot,
            "its gateway runs here, but has no link to its --connect endpoints: nobody elsewhere sees the robot",
            "see the findings on those endpoints; if there are none, check that its --connect and the doctor's agree",
        )
    yield from _check_gateways(robot, bus.accounts, evidence.seconds)
    for account in bus.accounts:
        yield from _check_account(robot, account, "is on the bus and waits for nothing")


def check_fleet(bus: BusLook, seconds: float) -> Iterator[Finding]:
    """Report the robots on the bus and the state of their gateways. seconds: listening time."""
    yield from _check_routers(bus)
    if _cut_off(bus):
        return
    accounts: dict[str, list[GatewayReport]] = {robot: [] for robot in bus.robots}
    for account in bus.accounts:
        accounts.setdefault(account.last.robot, []).append(account)
    if not accounts:
        yield replace(_absent("NAME", bus.robots), subject="the fleet")
        return
    yield note(
        Stage.GATEWAY,
        "--robot",
        f"is not given: these are the {len(accounts)} robots on the bus",
        "to have one examined, run `fleetsight doctor --robot NAME` on it, with its gateway's options",
    )
    for robot, of_robot in sorted(accounts.items()):
        yield from _check_gateways(robot, of_robot, seconds)
        for account in of_robot:
            yield from _check_account(robot, account, _offered(account))


def _offered(account: GatewayReport) -> str:
    streams = account.last.streams
    version = f" {account.last.version}" if account.last.version else ""
    return (
        f"{version} offers {len(streams)} streams, of which {sum(each.wanted for each in streams)} are wanted".strip()
    )


def _check_gateways(robot: str, accounts: Sequence[GatewayReport], seconds: float) -> Iterator[Finding]:
    """Check that a robot has exactly one gateway that sends a status."""
    if any(one.overlaps(other) for one, other in combinations(accounts, 2)):
        yield problem(
            Stage.GATEWAY,
            robot,
            "more than one gateway runs under this name: their frames get mixed up",
            "give each robot's gateway its own --robot, or stop the extra one",
        )
    if not accounts:
        yield problem(
            Stage.GATEWAY,
            robot,
            f"its gateway is present but sent no status in {seconds:g} s",
            "restart the gateway; if the network has access rules, they must let fleet/*/status through",
        )


def _check_account(robot: str, account: GatewayReport, well: str) -> Iterator[Finding]:
    """Report a gateway's state. well: its description if all is well."""
    if account.last.waiting_for:
        yield problem(
            Stage.GATEWAY,
            robot,
            f"the running gateway waits for {account.last.waiting_for}",
            "start what it waits for, or restart the gateway with the right --ros-master",
        )
    else:
        yield fine(Stage.GATEWAY, robot, f"its gateway {well}")
    if abs(account.skew_s) > SKEW_S:
        way = "ahead of" if account.skew_s > 0 else "behind"
        yield note(
            Stage.GATEWAY,
            robot,
            f"the robot's clock is {abs(account.skew_s):.1f} s {way} this machine's",
            "synchronise the clocks (chrony)",
        )


def _check_routers(bus: BusLook) -> Iterator[Finding]:
    say = problem if _cut_off(bus) or bus.at_home_only else note
    for router in bus.routers:
        if router.trouble is not None:
            what, advice = _router_trouble(router.endpoint, router.trouble)
            yield say(Stage.GATEWAY, router.endpoint, what, advice)


def _cut_off(bus: BusLook) -> bool:
    """Return whether no endpoint answers and scouting found no gateway."""
    return bool(bus.routers) and all(router.trouble for router in bus.routers) and not (bus.robots or bus.accounts)


def _router_trouble(endpoint: str, trouble: Trouble) -> tuple[str, str]:
    match trouble.failure:
        case Failure.UNRESOLVED:
            return (
                "the router's host name does not resolve on this machine",
                "add it to /etc/hosts here, or give its IP address with --connect",
            )
        case Failure.DEAD:
            everywhere = f"{endpoint.partition('/')[0]}/0.0.0.0:{port_of(endpoint)}"
            return (
                "no router listens there",
                f"start it (for other machines: `fleetsight monitor --listen {everywhere}`), or correct --connect",
            )
        case Failure.REFUSED:
            return (
                f"the bus cannot be joined: {trouble.reason}",
                "correct --mode, --connect or --listen, or the file that is named",
            )
        case Failure.FOREIGN if endpoint.startswith("tls/"):
            return (
                "something listens there, but no link with certificates can be made to it",
                "are both certificates of the same authority, and is the other's for this host? See docs/security.md",
            )
        case Failure.FOREIGN:
            return (
                "something listens there, but does not answer as a Zenoh router does",
                "correct the port in --connect (usually 7447), use tls/ if it has certificates, or restart it if hung",
            )
        case _:
            return "no answer from the router's machine", "is it on, in this network, and not behind a firewall?"


def _absent(robot: str, robots: frozenset[str]) -> Finding:
    if not robots:
        return problem(
            Stage.GATEWAY,
            robot,
            "no gateway of any robot is on this bus",
            f"start {_gateway(robot)}; if it runs, do its --connect and the doctor's name the same router?",
        )
    close = difflib.get_close_matches(robot, sorted(robots), n=1, cutoff=0.5)
    others = ", ".join(sorted(robots)[:10])
    return problem(
        Stage.GATEWAY,
        robot,
        f"no gateway of this name is on the bus; there are those of {others}",
        f"did you mean --robot {close[0]}?" if close else f"start {_gateway(robot)}",
    )


def _gateway(robot: str) -> str:
    return f"`fleetsight gateway --robot {robot}` with the other options that a gateway has and that are given here"
