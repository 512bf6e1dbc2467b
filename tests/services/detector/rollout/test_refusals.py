"""Models that failed: how long they are left alone, and how a start knows those that ended the process."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from services.detector import refusals
from services.detector.refusals import BLIND_RETRY_S, ENDED, RETRY_S, Refusals, growing_wait_s

A, B = "a" * 64, "b" * 64


def started(folder: Path) -> Refusals:
    made = Refusals(folder)
    made.recall()
    return made


def test_a_model_that_failed_is_left_alone_longer_each_time_and_shorter_if_no_other_runs(tmp_path: Path) -> None:
    known = started(tmp_path)
    assert known.wait_s({A, B}, blind=False) == math.inf
    known.refuse(A, "no memory")
    assert (known.why(A, blind=False), known.why(B, blind=False)) == ("no memory", None)
    for expected_s in (60, 120, 240):
        assert known.wait_s({A}, blind=False) == pytest.approx(expected_s, rel=0.3)
        assert known.wait_s({A}, blind=True) == pytest.approx(expected_s / 12, rel=0.3)
        known.refuse(A, "no memory")
    for _ in range(20):
        known.refuse(A, "no memory")
    assert known.wait_s({A}, blind=False) == pytest.approx(RETRY_S[1], rel=0.3)
    assert known.wait_s({A}, blind=True) == pytest.approx(BLIND_RETRY_S[1], rel=0.3)
    known.works(A)
    assert known.why(A, blind=False) is None


def test_it_may_be_tried_again_when_the_time_has_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = started(tmp_path)
    known.refuse(A, "no memory")
    monkeypatch.setattr(refusals, "RETRY_S", (0.0, 0.0))
    assert (known.why(A, blind=False), known.wait_s({A}, blind=False)) == (None, 0)


def test_a_model_that_kills_the_process_is_refused_by_later_ones_until_it_works(tmp_path: Path) -> None:
    code = "import os, sys; from pathlib import Path; from services.detector.refusals import Refusals\n"
    code += "Refusals(Path(sys.argv[1])).trying(sys.argv[2]); os.kill(os.getpid(), 9)"
    killed = subprocess.run([sys.executable, "-c", code, str(tmp_path), A], check=False)
    assert killed.returncode == -9
    known, neighbour = started(tmp_path), started(tmp_path)
    assert known.why(A, blind=False) == neighbour.why(A, blind=False) == ENDED
    assert known.wait_s({A}, blind=False) == pytest.approx(60, rel=0.3)
    known.trying(A)
    known.leave_marked(A)
    known = started(tmp_path)
    assert known.wait_s({A}, blind=False) == pytest.approx(120, rel=0.3)
    known.trying(A)
    known.works(A)
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_lives_or_ended_well_is_no_failure(tmp_path: Path) -> None:
    living = started(tmp_path)
    living.trying(A)
    assert started(tmp_path).why(A, blind=False) is None
    living.close()
    assert list(tmp_path.iterdir()) == []


def test_a_model_that_is_no_longer_wanted_is_forgotten(tmp_path: Path) -> None:
    before = started(tmp_path)
    before.trying(A)
    before.leave_marked(A)
    known = started(tmp_path)
    known.refuse(B, "no memory")
    known.forget_all_but({B})
    assert (known.why(A, blind=False), known.why(B, blind=False)) == (None, "no memory")
    assert list(tmp_path.iterdir()) == []


def test_waits_grow_up_to_a_limit_and_differ() -> None:
    for tries, expected_s in ((1, 5), (2, 10), (5, 80), (100, 600)):
        waits = [growing_wait_s(tries, 5, 600) for _ in range(100)]
        assert all(wait_s == pytest.approx(expected_s, rel=0.26) for wait_s in waits)
        assert len(set(waits)) > 90


def test_a_folder_that_cannot_be_written_is_no_failure(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    known = started(tmp_path / "file")
    known.trying(A)
    assert "if this model ends the process, it will be tried again" in caplog.text
    known.refuse(A, "no memory")
    known.works(A)
    assert known.why(A, blind=False) is None


def test_a_model_that_ends_every_start_leaves_one_mark(tmp_path: Path) -> None:
    for _ in range(10):
        dying = started(tmp_path)
        dying.trying(A)
        dying.leave_marked(A)
    assert len(list(tmp_path.iterdir())) == 2
    last = started(tmp_path)
    assert len(list(tmp_path.iterdir())) == 1
    assert last.why(A, blind=False) == ENDED
