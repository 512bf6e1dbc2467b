"""Notices peers that are gone without a word."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from asyncio import trsock

SILENCE_S = 25
_IDLE_S, _INTERVAL_S, _PROBES = 10, 5, 3


def notice_dead_peer(connection: socket.socket | trsock.TransportSocket, silence_s: float = SILENCE_S) -> None:
    """Have a TCP connection break about `SILENCE_S`, or `silence_s` if that is more, after its peer fell silent.

    One that drives out of the network sends no FIN. The time also limits how long sent data may wait for a peer that
    is there and takes nothing.
    """
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (
        (socket.TCP_KEEPIDLE, _IDLE_S),
        (socket.TCP_KEEPINTVL, _INTERVAL_S),
        (socket.TCP_KEEPCNT, _PROBES),
        (socket.TCP_USER_TIMEOUT, round(silence_s * 1000)),
    ):
        connection.setsockopt(socket.IPPROTO_TCP, option, value)
