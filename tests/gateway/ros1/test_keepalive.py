from __future__ import annotations

import socket

from gateway.ros1.keepalive import SILENCE_S, notice_dead_peer


def test_kernel_is_told_to_give_a_silent_peer_up() -> None:
    with socket.socket() as connection:
        notice_dead_peer(connection)
        assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        idle, interval, probes = (
            connection.getsockopt(socket.IPPROTO_TCP, option)
            for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)
        )
        assert idle + interval * probes == SILENCE_S
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == SILENCE_S * 1000


def test_more_patience_with_a_peer_that_takes_nothing() -> None:
    with socket.socket() as connection:
        notice_dead_peer(connection, 3600.0)
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 3_600_000
