from typing import Any

import pytest

from benchmarks.targets import at_least, at_most

FOUND: dict[str, Any] = {"fast": 9.0, "slow": 3.0, "none": None, "nothing": 0.0}


@pytest.mark.parametrize(("limit", "met"), [(9, True), (9.01, False)])
def test_a_figure_reaches_its_limit(limit: float, *, met: bool) -> None:
    assert at_least(FOUND, "fast", limit) == {"fast": {"value": 9.0, "at_least": limit, "met": met}}


@pytest.mark.parametrize(("limit", "met"), [(9, True), (8.99, False)])
def test_a_figure_stays_within_its_limit(limit: float, *, met: bool) -> None:
    assert at_most(FOUND, "fast", limit) == {"fast": {"value": 9.0, "at_most": limit, "met": met}}


def test_a_figure_beside_another() -> None:
    assert at_least(FOUND, "fast", 3, "slow") == {"fast / slow": {"ratio": 3.0, "at_least": 3, "met": True}}
    assert at_most(FOUND, "slow", 0.3, "fast") == {"slow / fast": {"ratio": 0.333, "at_most": 0.3, "met": False}}


def test_the_figure_that_none_can_pass_is_shown() -> None:
    (target,) = at_least(FOUND, "slow", 0.8, "fast", "slow").values()
    assert (target["ratio"], target["ceiling"]) == (0.333, 0.333)
    (target,) = at_most(FOUND, "fast", 4, "slow", "slow").values()
    assert (target["ratio"], target["floor"]) == (3.0, 1.0)


@pytest.mark.parametrize(("name", "other"), [("none", None), ("none", "fast"), ("fast", "nothing"), ("fast", "none")])
def test_what_could_not_be_measured_meets_no_target(name: str, other: str | None) -> None:
    for (target,) in (at_least(FOUND, name, 0, other).values(), at_most(FOUND, name, 1e9, other).values()):
        assert not target["met"]
