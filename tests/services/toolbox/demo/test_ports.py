import socket

import pytest

from services.toolbox.demo.ports import free_ports, is_free


@pytest.mark.parametrize("count", [1, 4])
def test_every_port_can_be_listened_on(count: int) -> None:
    first = free_ports(count)
    for port in range(first, first + count):
        with socket.socket() as listening:
            listening.bind(("127.0.0.1", port))


def test_a_port_that_somebody_listens_on_is_not_free() -> None:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port = listening.getsockname()[1]
        assert not is_free(port)
    assert is_free(port)
    assert is_free(0)
