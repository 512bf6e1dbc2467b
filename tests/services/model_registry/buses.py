"""Two connected processes' buses."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from bus import Bus, BusSettings, open_bus
from services.toolbox.demo.children import free_ports


@asynccontextmanager
async def two_buses() -> AsyncIterator[tuple[Bus, Bus]]:
    """Give the bus of a monitor, and that of somebody who is connected to it."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)}"
    async with (
        open_bus(BusSettings(mode="router", listen=[endpoint])) as monitor,
        open_bus(BusSettings(connect=[endpoint])) as other,
    ):
        yield monitor, other
