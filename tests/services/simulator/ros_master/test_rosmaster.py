"""Our master's port; what it answers is in tests/contract/test_ros_master.py and test_master_api.py."""

from __future__ import annotations

import pytest

from services.simulator.ros_master.master import RosMaster


async def test_port_can_be_given_and_is_free_again_afterwards() -> None:
    async with RosMaster() as first:
        port = int(first.uri.rstrip("/").rpartition(":")[2])
        with pytest.raises(OSError, match="Address already in use"):
            async with RosMaster(port=port):
                pass
    async with RosMaster(port=port) as second:
        assert second.uri == first.uri
