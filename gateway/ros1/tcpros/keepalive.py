"""Detects peers that vanished silently, and tolerates slow ones."""

from __future__ import annotations

import socket
import struct
from typing import TYPE_CHECKING, Final, NamedTuple, Self

if TYPE_CHECKING:
    from asyncio import trsock

SILENCE_S: Final = 25
_IDLE_S, _INTERVAL_S, _PROBES = 10, 5, 3

_TCP_INFO: Final = struct.Struct("=2x2B52xI")
"""Start of struct tcp_info in linux/tcp.h, with tcpi_retransmits, tcpi_probes and tcpi_last_ack_recv."""


def notice_dead_peer(connection: socket.socket | trsock.TransportSocket) -> None:
    """Make an idle TCP connection break about SILENCE_S after its peer went silent.

    One that drives out of the network sends no FIN. While something is sent the kernel does not probe: ask `is_gone`.
    """
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (
        (socket.TCP_KEEPIDLE, _IDLE_S),
        (socket.TCP_KEEPINTVL, _INTERVAL_S),
        (socket.TCP_KEEPCNT, _PROBES),
    ):
        connection.setsockopt(socket.IPPROTO_TCP, option, value)


class Acknowledgement(NamedTuple):
    """Acknowledgement state of a connection. retransmits, probes: unanswered in a row. age_ms: of the last one."""

    retransmits: int
    probes: int
    age_ms: int

    @classmethod
    def of(cls, connection: socket.socket) -> Self:
        """Return the state from the kernel."""
        return cls.read(connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO.size))

    @classmethod
    def read(cls, info: bytes) -> Self:
        """Return the state from a struct tcp_info, or a neutral one if it is short, as from an emulated kernel."""
        return cls(*_TCP_INFO.unpack(info)) if len(info) == _TCP_INFO.size else cls(0, 0, 0)

    @property
    def is_overdue(self) -> bool:
        """Whether the peer counts as gone.

        A peer that takes nothing, as rospy does while a callback runs, answers probes, which the kernel sends ever
        more rarely, at last every two minutes: the time alone tells nothing. TCP_USER_TIMEOUT goes by it.
        """
        return self.age_ms > SILENCE_S * 1000 and (self.retransmits > 0 or self.probes >= _PROBES)


def is_gone(connection: socket.socket) -> bool:
    """Return whether a peer has acknowledged no retransmitted data for SILENCE_S.

    Of one that took nothing for long before it went, that shows after some minutes.
    """
    return Acknowledgement.of(connection).is_overdue
