"""Translates BusSettings to Zenoh's configuration. Pure."""

from collections.abc import Mapping
from math import ceil
from typing import Any, Final

from bus.api import MAX_PAYLOAD_BYTES
from bus.session.link_use import MAX_LINKS
from bus.settings import BusSettings

OPEN_TIMEOUT_MS: Final = 1_000
"""Longest duration of one attempt to connect that a session's opening waits for."""

BACKGROUND_MS: Final = 1_500
"""The same in the background: a router that is busy takes a while. Closing a session waits for it (Zenoh 1.10).

A client with several routers waits for one no longer than when it opens: it tries the endpoints in their order, and the
first may be the one that is gone.
"""

ACCEPT_MS: Final = 5_000
"""The same for who is connected to, as by a whole fleet after a router's restart."""

MAX_BLOCKED_MS: Final = 1_000
"""Time for which a link may block a declaration before it counts as lost; shorter than the deadline for closing."""

MAX_FLUSH_MS: Final = 500
"""Longest keep-alive interval; a closing link waits as long to write its queue."""

RETRY: Final = {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 2}
NO_RETRY: Final = {"period_init_ms": 3_600_000, "period_max_ms": 3_600_000, "period_increase_factor": 1}
"""A client that nobody connects to ends the session with its link, and opens a new one."""

NEIGHBOURS: Final = [{"filters": [{"modes": ["client", "peer"]}]}]
"""Processes that connect to a client form their own Zenoh region, which the client represents at the router.

As a router among routers it would be sent all declarations of all others (Zenoh 1.10): of a thousand robots about a
gigabyte whenever their common router is restarted.
"""

REQUEST_BATCHES: Final = 16
"""Size of a link's queue of requests and replies, which have a priority of their own: 1 MiB fits at once."""

IMAGE_BATCHES: Final = 16
"""Size of a link's image queue, in batches of 64 KiB; with the default of 2 a frame takes many rounds to send."""

MAX_FRAGMENTS_WAIT_US: Final = 2_500_000
"""How long all fragments of a message that may be dropped wait for a link, 1 ms each: enough for MAX_MESSAGE_BYTES.

With 50 ms, the default, messages of some dozen megabytes are never sent whole, not even within a machine.
"""

SOCKET_BYTES: Final = 256 << 10
"""Socket buffer at each end of a link; the system's default may hold a dozen images."""

MAX_MESSAGE_BYTES: Final = MAX_PAYLOAD_BYTES + (128 << 10)
"""Largest message that a link receives: the largest payload, its key and attachment. A larger one is lost.

A router holds as much for each priority of a link, twice, for reliable messages and others, until messages are whole.
"""


def session_config(
    settings: BusSettings,
    links: int = MAX_LINKS,
    access: Mapping[str, Any] | None = None,
    *,
    first: str = "",
    prefix: str = "",
) -> dict[str, Any]:
    """Return Zenoh's configuration as a dict for JSON.

    links: how many there may be; they may come all at once, as after a restart. access: rules, as Zenoh has them.
    first: an endpoint to connect to before the others. prefix: keys of which a router is told as one that they are
    published, instead of each. Not by a client to which others connect: Zenoh (1.10) then sends the router what they
    alone subscribe to, as it looks for subscribers of a key only where that key itself was declared.

    Timestamping is off: a subscriber with history drops what a router's clock puts out of order.
    """
    lease_ms = round(settings.lease_s * 1000)
    has_choice = settings.mode == "client" and len(settings.connect) > 1
    blocked_us = min(lease_ms, MAX_BLOCKED_MS) * 1_000
    rules = {} if access is None else {"access_control": access}
    own = rules | ({"gateway": {"south": NEIGHBOURS}} if settings.is_listening_client else {})
    if prefix and not settings.is_listening_client:
        own |= {"aggregation": {"publishers": [f"{prefix}/**"], "subscribers": []}}
    return own | {
        "mode": settings.mode,
        "connect": {
            "endpoints": [first, *settings.connect] if first else settings.connect,
            # A client's session tries once; routers and peers are open at once and keep trying.
            "timeout_ms": 0 if settings.mode == "client" else -1,
            "exit_on_failure": settings.mode == "client",
            "retry": NO_RETRY if settings.has_one_link else RETRY,
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
                "open_timeout": OPEN_TIMEOUT_MS if settings.has_one_link or has_choice else BACKGROUND_MS,
                "accept_timeout": ACCEPT_MS,
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
    """Return the TLS settings: both ends need certificates of the same authority, the listener's for its host name."""
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
        # Zenoh knows no list of revoked certificates: short-lived ones are how a lost one ends.
        "close_link_on_expiration": True,
    }
