from benchmarks.guide.limits import link_ms, memcpy_ms, tcp_ms
from bus import BusSettings, open_bus
from services.toolbox.demo.children import free_ports


def test_bytes_take_time() -> None:
    assert memcpy_ms(1_000_000) > 0
    assert tcp_ms(1_000_000) > 0
    assert tcp_ms(1) > 0


async def test_a_link_takes_time() -> None:
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with open_bus(BusSettings(mode="router", listen=[endpoint])):
        assert await link_ms(endpoint, 1_000_000) > 0
