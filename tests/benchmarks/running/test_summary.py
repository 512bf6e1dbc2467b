from typing import Any

from benchmarks.running.summary import missed, outcome


def of(**targets: dict[str, Any]) -> dict[str, Any]:
    return {"benchmark": "speed", "targets": targets}


def test_how_many_targets_are_met() -> None:
    met, not_met = {"value": 3, "at_least": 2, "met": True}, {"value": 1, "at_least": 2, "met": False}
    assert outcome(of(a=met, b=not_met)) == "1 of 2 targets met"
    assert outcome(of()) == "measured"


def test_what_is_missed_is_said_beside_what_was_aimed_at() -> None:
    assert list(
        missed(
            of(
                good={"value": 3, "at_least": 2, "met": True},
                slow={"value": {"min": 1, "median": 1.25, "max": 2.5}, "at_least": 2, "met": False},
                old={"ratio": 0.5, "at_most": 0.333, "met": False},
                out_of_reach={"ratio": 0.7, "at_least": 0.8, "met": False, "ceiling": 0.75},
                unknown={"value": None, "at_most": 1, "met": False, "ceiling": None},
            )
        )
    ) == [
        "speed: slow is 1.25 (1 to 2.5), not at least 2",
        "speed: old is 0.5, not at most 0.333",
        "speed: out_of_reach is 0.7, not at least 0.8; nothing here can pass 0.75",
        "speed: unknown is unknown, not at most 1",
    ]
