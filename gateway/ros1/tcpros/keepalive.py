"""Notices peers that are gone without a word, and has patience with those that are only slow."""

from __future__ import annotations

import socket
import struct
from typing import TYPE_CHECKING, Final, NamedTuple, Self

if TYPE_CHECKING:
    from asyncio import trsock

SILENCE_S: Final = 25
_IDLE_S, _INTERVAL_S, _PROBES = 10, 5, 3

_TCP_INFO: Final = struct.Struct("=2x2B52xI")
"""How struct tcp_info of linux/tcp.h begins: of it tcpi_retransmits, tcpi_probes and tcpi_last_ack_recv."""


def notice_dead_peer(connection: socket.socket | trsock.TransportSocket) -> None:
    """Have a TCP connection on which nothing is sent break about SILENCE_S after its peer fell silent.

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
    """What became of what was sent. retransmits, probes: how often in a row nothing came back; age_ms: of the last."""

    retransmits: int
    probes: int
    age_ms: int

    @classmethod
    def of(cls, connection: socket.socket) -> Self:
        """Ask the kernel."""
        return cls.read(connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO.size))

    @classmethod
    def read(cls, info: bytes) -> Self:
        """Read a struct tcp_info; a shorter one, as an emulated kernel gives, tells nothing."""
        return cls(*_TCP_INFO.unpack(info)) if len(info) == _TCP_INFO.size else cls(0, 0, 0)

    @property
    def is_overdue(self) -> bool:
        """Whether nobody is there any more.

        A peer that takes nothing, as rospy does while a callback runs, answers probes, which the kernel sends ever
        more rarely, at last every two minutes: the time alone tells nothing. TCP_USER_TIMEOUT goes by it.
        """
        return self.age_ms > SILENCE_S * 1000 and (self.retransmits > 0 or self.probes >= _PROBES)


def is_gone(connection: socket.socket) -> bool:
    """Return whether a peer has acknowledged nothing for SILENCE_S of what is sent to it again and again.

    Of one that took nothing for long before it went, that shows after some minutes.
    """
    return Acknowledgement.of(connection).is_overdue
