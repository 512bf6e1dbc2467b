"""The cost of access rules, over few messages: the figures of many are of the same kind."""

from pathlib import Path

import pytest

from benchmarks.security import cost


def test_a_message_and_a_robot_that_joins_are_timed_with_rules_and_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, few in (("MESSAGES", 100), ("ROUNDS", 1), ("JOINS", 1)):
        monkeypatch.setattr(cost, name, few)
    found = cost.cost_of_rules(tmp_path / "pki")
    assert found["acl_us_per_message"] == pytest.approx(
        found["us_per_message_with_rules"] - found["us_per_message_without"], abs=0.02
    )
    assert min(found["us_per_message_with_rules"], found["us_per_message_without"]) > 0
    assert found["rules_for_robots"] == 1_000
    assert min(found["joining_ms_with_rules"], found["joining_ms_without"]) > 0
