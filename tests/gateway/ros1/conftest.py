from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from blockbuster import blockbuster_ctx

from services.simulator.ros_master.master import RosMaster

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Iterator


@pytest.fixture(autouse=True)
def no_blocking_calls() -> Iterator[None]:
    """Fail a test in which our code blocks the event loop."""
    with blockbuster_ctx("gateway.ros1"):
        yield


@pytest.fixture
async def master() -> AsyncIterator[RosMaster]:
    """Run a ROS master."""
    async with RosMaster() as running:
        yield running
