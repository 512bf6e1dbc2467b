"""Checks the ROS master, and this machine's address as other nodes see it. Pure."""

import ipaddress
from collections.abc import Iterator
from typing import Final

from gateway.doctor.evidence import Failure, Graph, HostLook, MasterLook, Trouble
from gateway.doctor.finding import Finding, Stage, fine, note, problem
from gateway.to_ros.outputs import is_result

_LOGS: Final = frozenset({"/rosout", "/rosout_agg"})


def check_master(look: MasterLook) -> Iterator[Finding]:
    """Report whether the master answers, or why not."""
    if look.trouble is not None:
        what, advice = _master_trouble(look.trouble)
        yield problem(Stage.MASTER, look.uri, what, advice)
    elif look.graph is not None and (topics := _topics(look.graph)):
        yield fine(Stage.MASTER, look.uri, f"answers; {len(topics)} topics have publishers")
    else:
        yield note(
            Stage.MASTER,
            look.uri,
            "answers, but no sensor publishes anything at it",
            "start the drivers; if they run, check ROS_MASTER_URI where they were started: it may be another master",
        )


def _topics(graph: Graph) -> list[str]:
    """Return the published topics except ROS's log and gateways' results."""
    return [topic for topic in graph.publishers if topic not in _LOGS and not is_result(topic)]


def _master_trouble(trouble: Trouble) -> tuple[str, str]:
    match trouble.failure:
        case Failure.UNRESOLVED:
            return (
                f"the host name {trouble.host} does not resolve on this machine",
                "add it to /etc/hosts here, or write the master's IP address into --ros-master or ROS_MASTER_URI",
            )
        case Failure.DEAD:
            return (
                f"nothing listens at {trouble.where}: no ROS master runs there",
                "start roscore, or correct --ros-master or ROS_MASTER_URI (a master's port is usually 11311)",
            )
        case Failure.REFUSED | Failure.FOREIGN:
            return (
                f"something answers at {trouble.where}, but not as a ROS master does: {trouble.reason}",
                "correct the port in --ros-master or ROS_MASTER_URI; a master's is usually 11311",
            )
        case _:
            return (
                f"no answer from {trouble.where} ({trouble.reason or trouble.failure.value})",
                "is that machine on, in this network, and not behind a firewall? If it is, roscore hangs: restart it",
            )


def check_host(look: HostLook, *, remote_master: bool) -> Iterator[Finding]:
    """Check that other nodes can connect to the host they are told."""
    if not look.addresses:
        yield problem(
            Stage.HOST,
            look.host,
            "this machine tells other nodes to connect to a name that does not resolve",
            "set ROS_IP to this machine's address, without ROS_HOSTNAME (or --ros-host), or add the name to /etc/hosts "
            "on every machine",
        )
    elif any(ipaddress.ip_address(address).is_unspecified for address in look.addresses):
        yield problem(Stage.HOST, look.host, "is not an address that others can connect to", "set ROS_IP to a real one")
    elif remote_master and all(ipaddress.ip_address(address).is_loopback for address in look.addresses):
        yield from _loopback(look.host)
    elif not look.ours:
        yield problem(
            Stage.HOST,
            look.host,
            f"is not an address of this machine ({', '.join(look.addresses)}): nothing here can listen there",
            "set ROS_IP or ROS_HOSTNAME (or --ros-host) to an address this machine has now: see `ip address`",
        )
    else:
        yield fine(Stage.HOST, look.host, "other nodes are told to connect here, and something can listen here")


def _loopback(host: str) -> Iterator[Finding]:
    """Report a host that is the loopback of this machine while the master runs on another."""
    advice = "set ROS_IP (or --ros-host) to this machine's address in the robot's network"
    if host == "localhost" or host.replace(".", "").isdigit() or ":" in host:
        what = "the ROS master is on another machine, whose nodes cannot connect back to this loopback address"
        yield problem(Stage.HOST, host, what, advice)
    else:
        what = "resolves to the loopback here, and the ROS master is on another machine: does it resolve right there?"
        yield note(Stage.HOST, host, what, advice)
