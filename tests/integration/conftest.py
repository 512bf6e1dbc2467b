from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.integration.peers.ros import RosEnvironment, real_master, require_ros

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path


@pytest.fixture
def ros_installed() -> None:
    """Skip, or fail in CI, where Debian's ROS is missing."""
    require_ros()


@pytest.fixture
async def ros(ros_installed: None, tmp_path: Path) -> AsyncIterator[RosEnvironment]:  # noqa: ARG001 - its effect counts
    """Debian's real ROS with a rosmaster of the test's own."""
    async with real_master(tmp_path) as environment:
        yield environment
