"""A small fleet, and a program that has joined it."""

from collections.abc import AsyncIterator

import pytest

import fleetsight
from fleetsight import Fleet
from tests.fleetsight.stand_in import StandIn, stand_in


@pytest.fixture
async def there() -> AsyncIterator[StandIn]:
    async with stand_in() as made:
        yield made


@pytest.fixture
async def fleet(there: StandIn) -> AsyncIterator[Fleet]:
    async with fleetsight.connect(there.endpoint) as joined:
        yield joined
