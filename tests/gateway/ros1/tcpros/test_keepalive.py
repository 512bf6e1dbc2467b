from __future__ import annotations

import asyncio
import socket
from contextlib import suppress

import pytest

from gateway.ros1.tcpros.keepalive import SILENCE_S, Acknowledgement, is_gone, notice_dead_peer

SILENT_MS = SILENCE_S * 1000


def test_kernel_is_told_to_give_a_silent_peer_up_but_none_that_is_only_slow() -> None:
    with socket.socket() as connection:
        notice_dead_peer(connection)
        assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        idle, interval, probes = (
            connection.getsockopt(socket.IPPROTO_TCP, option)
            for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)
        )
        assert idle + interval * probes == SILENCE_S
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 0


@pytest.mark.parametrize(
    ("acknowledgement", "overdue"),
    [
        pytest.param(Acknowledgement(retransmits=1, probes=0, age_ms=SILENT_MS + 1), True, id="nothing comes back"),
        pytest.param(Acknowledgement(retransmits=9, probes=0, age_ms=SILENT_MS), False, id="not for long"),
        pytest.param(Acknowledgement(retransmits=0, probes=3, age_ms=SILENT_MS + 1), True, id="no probe is answered"),
        pytest.param(Acknowledgement(retransmits=0, probes=2, age_ms=120_000), False, id="probes are rare"),
        pytest.param(Acknowledgement(retransmits=0, probes=0, age_ms=120_000), False, id="nothing is asked"),
    ],
)
def test_a_peer_is_gone_when_it_is_asked_again_and_again_in_vain(
    acknowledgement: Acknowledgement, *, overdue: bool
) -> None:
    assert acknowledgement.is_overdue == overdue


def test_a_kernel_that_tells_nothing_makes_nobody_gone() -> None:
    assert Acknowledgement.read(bytes(2) + b"\x09\x09" + bytes(52) + b"\xff" * 4).is_overdue
    assert not Acknowledgement.read(b"\xff" * 4).is_overdue


async def test_a_peer_that_takes_nothing_answers_probes() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        socket.create_connection(listener.getsockname()) as busy,
        listener.accept()[0] as connection,
    ):
        connection.setblocking(False)  # noqa: FBT003 - socket's own signature
        notice_dead_peer(connection)
        with suppress(BlockingIOError):
            while True:
                connection.send(bytes(1 << 20))
        asked = []
        for _ in range(20):  # the kernel probes after 0.2, 0.6 and 1.4 s
            await asyncio.sleep(0.1)
            asked.append(Acknowledgement.of(connection))
        assert {each.retransmits for each in asked} == {0}
        assert max(each.probes for each in asked) < 2
        assert not is_gone(connection)
        assert busy.recv(1) == b"\0"
