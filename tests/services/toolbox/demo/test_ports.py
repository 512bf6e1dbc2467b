import socket

import pytest

from services.toolbox.demo.children import free_ports


@pytest.mark.parametrize("count", [1, 4])
def test_every_port_can_be_listened_on(count: int) -> None:
    first = free_ports(count)
    for port in range(first, first + count):
        with socket.socket() as listening:
            listening.bind(("127.0.0.1", port))
