"""One fault, end to end: real processes, and the history that the monitor keeps."""

import json
import subprocess
import sys
from argparse import ArgumentTypeError

import pytest

from benchmarks.chaos.__main__ import _faults, targets
from benchmarks.chaos.faults import THIN, faults


@pytest.mark.timeout(180)
def test_a_gateway_that_is_killed_costs_no_class_list() -> None:
    command = [sys.executable, "-m", "benchmarks.chaos", "--json", "--faults", "SIGKILL gateway"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    (fault,) = found["faults"]
    assert fault["recovered_s"] is not None, done.stderr
    assert (fault["lost_lists"], fault["lost_alerts"], fault["doubled"]) == (0, 0, 0), fault
    assert fault["lists"] > 0
    assert (found["number"], found["left_out"]) == (1, {})


def test_there_are_as_many_faults_as_aimed_at_and_each_has_a_name_of_its_own() -> None:
    names = [fault.name for fault in faults()]
    assert len(names) == len(set(names)) >= 20
    assert THIN in names


def test_a_fault_that_there_is_not_is_named_with_those_that_there_are() -> None:
    with pytest.raises(ArgumentTypeError, match=r"no fault is called 'fire'; there are SIGKILL gateway, .*full disk"):
        _faults("SIGKILL gateway, fire")


def test_a_fleet_that_is_not_well_again_meets_no_target() -> None:
    well = {
        "name": THIN,
        "recovered_s": 1.0,
        "lost": 0,
        "doubled": 0,
        "stuck_alerts": 0,
        "age_p99_ms": 200.0,
        "frames": {"unattributed": -1},
        "files_growth": 1,
        "rss_growth_mb": 20.0,
    }
    ill = {"name": "fire", "recovered_s": None, "lost": None, "doubled": None}
    assert all(target["met"] for name, target in targets([well]).items() if name != "number")
    met = {name: target["met"] for name, target in targets([well, ill]).items()}
    assert met == {
        "number": False,
        "recovered_s": False,
        "lost": False,
        "doubled": False,
        "stuck_alerts": False,
        "age_p99_ms": True,
        "unattributed": True,
        "files_growth": True,
        "rss_growth_mb": True,
    }
    leaking = {**well, "files_growth": 3, "rss_growth_mb": 51.0, "frames": {"unattributed": 3}}
    missed = {name for name, target in targets([well, leaking]).items() if not target["met"]}
    assert missed == {"number", "unattributed", "files_growth", "rss_growth_mb"}
