from __future__ import annotations

import pytest

from gateway.ros1.errors import TcprosError
from gateway.ros1.wire.framing import FrameBudget


def test_as_much_as_there_is_and_no_more() -> None:
    budget = FrameBudget(10)
    budget.take(10)
    with pytest.raises(TcprosError, match="hold 10 bytes, 1 more"):
        budget.take(1)
    assert budget.held_bytes == 10
    budget.take(-4)
    budget.take(4)
    assert budget.held_bytes == 10
