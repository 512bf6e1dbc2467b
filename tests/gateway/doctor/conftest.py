"""A ROS master and the doctor's client of it."""

from collections.abc import AsyncIterator

import pytest

from gateway.doctor.robot import PoliteClient
from services.simulator.ros_master.master import RosMaster


@pytest.fixture
async def master() -> AsyncIterator[RosMaster]:
    async with RosMaster() as running:
        yield running


@pytest.fixture
def patience_s() -> float:
    return 20.0


@pytest.fixture
async def client(patience_s: float) -> AsyncIterator[PoliteClient]:
    async with PoliteClient(timeout=patience_s) as entered:
        yield entered
