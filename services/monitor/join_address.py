"""The address at which robots and workers join: one that others can reach, as far as this machine knows."""

import fcntl
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from ipaddress import ip_address
from typing import Final

from bus.session.links import host_of, is_loopback, is_unspecified
from bus.settings import port_of
from services.monitor.settings import MonitorSettings

UNKNOWN: Final = "tcp/MONITOR:7447"
"""Placeholder for an unknown address: scouting finds the router, or the system chose the port."""

SIOCGIFADDR: Final = 0x8915
"""Linux's request for the IPv4 address of a network interface."""

ELSEWHERE: Final = ((socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1"))
"""Documentation addresses of RFC 5737 and 3849, outside this machine. Nothing is sent to them."""

ALSO_ELSEWHERE: Final = "That is this machine alone. For others, start the monitor with --listen tls/0.0.0.0:7447."


def endpoints_to_join(settings: MonitorSettings) -> list[str]:
    """Return the Zenoh endpoints for robots and workers to connect to, the most widely reachable first."""
    if settings.advertise is not None:
        return [settings.advertise]
    own = [_reachable(endpoint) for endpoint in settings.listen if port_of(endpoint) != "0"]
    return sorted([*own, *settings.connect], key=is_loopback)


def endpoint_to_join(settings: MonitorSettings) -> str:
    """Return the endpoint to show to people for connecting."""
    return next(iter(endpoints_to_join(settings)), UNKNOWN)


def how_to_join(settings: MonitorSettings) -> str:
    """Return one line for the terminal that says how others join."""
    if settings.listen or settings.advertise is not None:
        return f"gateways and detectors join with --connect {endpoint_to_join(settings)}"
    return f"connects to {', '.join(settings.connect) or 'routers found by scouting'}"


def _reachable(endpoint: str) -> str:
    """Return an endpoint that is listened on as others connect to it: with an address in place of all of them."""
    plain, _, options = endpoint.partition("#")
    host = host_of(plain)
    if not is_unspecified(host):
        return plain
    interface = options.removeprefix("iface=") if options.startswith("iface=") else ""
    found = own_address(interface, ipv4_alone="." in host)
    return f"{plain.partition('/')[0]}/{f'[{found}]' if ':' in found else found}:{port_of(plain)}"


def own_address(interface: str = "", *, ipv4_alone: bool = False) -> str:
    """Return an address at which other machines reach this one; its host name where it has none.

    ipv4_alone: IPv6 is not listened on. interface: that of one of its networks alone. Else it is the address that
    packets to elsewhere would leave from or, without such a route, that of the first network.
    """
    return next(_addresses(interface, ipv4_alone), socket.gethostname())


def _addresses(interface: str, ipv4_alone: bool) -> Iterator[str]:  # noqa: FBT001 - private
    if not interface:
        for family, elsewhere in ELSEWHERE[: 1 if ipv4_alone else None]:
            with suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.connect((elsewhere, 9))  # of a datagram socket, which sends nothing
                yield str(probe.getsockname()[0])
    names = [interface] if interface else [name for _, name in socket.if_nameindex()]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for name in names:
            with suppress(OSError):  # it has no IPv4 address, or is none
                answer = fcntl.ioctl(probe.fileno(), SIOCGIFADDR, struct.pack("256s", name.encode()[:15]))
                address = socket.inet_ntoa(answer[20:24])
                if interface or not ip_address(address).is_loopback:
                    yield address
