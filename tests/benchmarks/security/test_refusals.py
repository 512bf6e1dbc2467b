import json
import subprocess
import sys
from pathlib import Path

from benchmarks.peers.flood import FLOODS
from benchmarks.peers.link_flood import FLOODS as LINK_FLOODS
from benchmarks.security.__main__ import targets
from schemas import codec

CASES = """
import pytest

@pytest.mark.parametrize(("name", "allowed"), [("a", True), ("b", False), ("c", False)])
def test_what_it_does(name, allowed):
    assert name != "c"

def test_nobody_does_it():
    pass

@pytest.fixture
def broken():
    raise OSError

@pytest.mark.parametrize("allowed", [True, False])
def test_what_was_not_tried(broken, allowed):
    pass

@pytest.fixture
def left_behind():
    yield
    raise OSError

def test_what_was_not_cleaned_up(left_behind):
    pass
"""
RUN = """
import contextlib, io, json, sys, pytest
from benchmarks.security.refusals import Refusals
counted = Refusals()
with contextlib.redirect_stdout(io.StringIO()):
    pytest.main(["-q", "-p", "no:cacheprovider", sys.argv[1]], [counted])
print(json.dumps(counted.figures()))
"""


def test_what_is_forbidden_is_counted_and_what_passed_of_it_by_test(tmp_path: Path) -> None:
    (tmp_path / "test_cases.py").write_text(CASES, encoding="utf-8")
    ran = subprocess.run(
        [sys.executable, "-c", RUN, str(tmp_path / "test_cases.py")], capture_output=True, text=True, check=True
    )
    found = json.loads(ran.stdout)
    assert (found["cases"], found["refused"], found["allowed_as_meant"]) == (5, 3, 1)
    assert found["groups"] == {
        "nobody_does_it": {"cases": 1, "refused": 1},
        "what_it_does": {"cases": 2, "refused": 1},
        "what_was_not_cleaned_up": {"cases": 1, "refused": 1},
        "what_was_not_tried": {"cases": 1, "refused": 0},
    }
    assert found["not_passed"] == 4
    assert [each.rpartition("::")[2] for each in found["not_passed_tests"]] == [
        "test_what_it_does[c-False] (call)",
        "test_what_was_not_tried[True] (setup)",
        "test_what_was_not_tried[False] (setup)",
        "test_what_was_not_cleaned_up (teardown)",
    ]


def test_a_target_is_missed_when_one_attempt_succeeds_or_a_flood_takes_too_much() -> None:
    kinds = (*FLOODS, *LINK_FLOODS, "masks")
    found = {f"{kind}_{what}": 1.0 for kind in kinds for what in ("rss_growth_mb", "answers_s")}
    found["robot_others_s"] = 1.0
    met = targets({"cases": 9, "refused": 9, "not_passed": 0, **found})
    assert all(each["met"] for each in met.values())
    missed = targets(
        {
            "cases": 9,
            "refused": 8,
            "not_passed": 1,
            **found,
            "names_rss_growth_mb": 201.0,
            "robot_others_s": 2.1,
            "masks_answers_s": 2.1,
        }
    )
    assert {name for name, each in missed.items() if not each["met"]} == {
        "refused / cases",
        "not_passed",
        "names_rss_growth_mb",
        "robot_others_s",
        "masks_answers_s",
    }


def test_what_floods_is_what_receivers_read() -> None:
    for made in FLOODS.values():
        _, message = next(made())
        codec.decode(type(message), codec.encode(message), codec.encoding(type(message)))
