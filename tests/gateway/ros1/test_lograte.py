from __future__ import annotations

from logging import DEBUG, WARNING

from gateway.ros1.lograte import LogRate


def test_warns_as_often_as_allowed_in_each_period() -> None:
    rate = LogRate(burst=2, period=60.0)
    assert [rate.level(now) for now in (0.0, 1.0, 2.0, 59.9)] == [WARNING, WARNING, DEBUG, DEBUG]
    assert [rate.level(now) for now in (60.0, 61.0, 62.0)] == [WARNING, WARNING, DEBUG]
