"""What BusSettings mean to Zenoh. Pure."""

from math import ceil
from typing import Any, Final

from bus.session.link_use import MAX_LINKS
from bus.settings import BusSettings

OPEN_TIMEOUT_MS: Final = 1_000
"""How long one attempt to connect may take."""

MAX_BLOCKED_MS: Final = 1_000
"""How long a link may refuse a declaration before it counts as lost; short of the deadline for closing."""

MAX_FLUSH_MS: Final = 500
"""Longest time between signs of life, which is also how long a closing link waits to write what it holds."""

RETRY: Final = {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 2}
NO_RETRY: Final = {"period_init_ms": 3_600_000, "period_max_ms": 3_600_000, "period_increase_factor": 1}
"""A client's session is ended and another one opened where its link is lost."""

REQUEST_BATCHES: Final = 16
"""Room of a link's queue of requests and replies, which alone have their priority: 1 MiB goes in without waiting."""

IMAGE_BATCHES: Final = 16
"""Batches of 64 KiB that wait for a link in its image queue: with 2, the default, a frame takes many turns to send."""

MAX_FRAGMENTS_WAIT_US: Final = 2_500_000
"""How long all fragments of a message that may be dropped wait for a link, 1 ms each: enough for MAX_MESSAGE_BYTES.

With 50 ms, the default, messages of some dozen megabytes are never sent whole, not even within a machine.
"""

SOCKET_BYTES: Final = 256 << 10
"""What the system holds at each end of a link; left to itself it is a dozen images."""

MAX_MESSAGE_BYTES: Final = (128 << 20) + (64 << 10)
"""What a link takes in at most as one message: the largest payload that anybody reads, and what is around it."""


def session_config(settings: BusSettings, links: int = MAX_LINKS) -> dict[str, Any]:
    """Return Zenoh's configuration, ready to be written as JSON.

    links: how many there may be; they may come all at once, as after a restart.

    Timestamping is off: a subscriber with history drops what a router's clock puts out of order.
    """
    lease_ms = round(settings.lease_s * 1000)
    blocked_us = min(lease_ms, MAX_BLOCKED_MS) * 1_000
    return {
        "mode": settings.mode,
        "connect": {
            "endpoints": settings.connect,
            # One try for a client's session; others' are open at once and go on trying.
            "timeout_ms": 0 if settings.mode == "client" else -1,
            "exit_on_failure": settings.mode == "client",
            "retry": NO_RETRY if settings.mode == "client" else RETRY,
        },
        "listen": {"endpoints": settings.listen, "timeout_ms": 0, "exit_on_failure": True},
        "scouting": {
            "timeout": OPEN_TIMEOUT_MS,
            "delay": 500 if settings.scouting else 0,
            "multicast": {"enabled": settings.scouting},
        },
        "timestamping": {"enabled": False},
        "transport": {
            "unicast": {
                "open_timeout": OPEN_TIMEOUT_MS,
                "accept_timeout": OPEN_TIMEOUT_MS,
                "accept_pending": links,
                "max_sessions": links,
            },
            "link": {
                "tcp": {"so_sndbuf": SOCKET_BYTES, "so_rcvbuf": SOCKET_BYTES},
                "tls": _tls(settings),
                "tx": {
                    "lease": lease_ms,
                    "keep_alive": max(4, ceil(lease_ms / MAX_FLUSH_MS)),
                    "queue": {
                        "size": {"data_low": IMAGE_BATCHES, "interactive_low": REQUEST_BATCHES},
                        "congestion_control": {
                            "drop": {"max_wait_before_drop_fragments": MAX_FRAGMENTS_WAIT_US},
                            "block": {"wait_before_close": blocked_us},
                        },
                    },
                },
                "rx": {"max_message_size": MAX_MESSAGE_BYTES},
            },
            "shared_memory": {"enabled": settings.shared_memory},
        },
    }


def _tls(settings: BusSettings) -> dict[str, Any]:
    """Have both ends of a link show a certificate of the same authority, and the listener's be for the name sought."""
    sockets = {"so_sndbuf": SOCKET_BYTES, "so_rcvbuf": SOCKET_BYTES}
    if settings.tls_ca is None:
        return sockets
    certificate, key = str(settings.tls_certificate), str(settings.tls_key)
    return sockets | {
        "root_ca_certificate": str(settings.tls_ca),
        "enable_mtls": True,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
    }
