"""A training run as a process of its own, with the processes that it begins."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from services.toolbox.train.inference import open_weights
from services.toolbox.train.refinement import REFINEMENT
from services.training.files import TrainingError
from services.training.process import run
from services.training.settings import TrainingSettings
from tests.services.training.test_photographs import folder_with
from tests.services.training.test_pool import runs, wait_until

SLOW_BEGINNING = """
import sys, time
if "multiprocessing.spawn" in " ".join(sys.orig_argv):
    time.sleep(60)
"""
"""As if what a process that renders has to import took very long."""


def begun_by(pid: int) -> list[int]:
    """Return the processes that a process began, in any of its threads."""
    return [
        int(each) for task in Path(f"/proc/{pid}/task").iterdir() for each in (task / "children").read_text().split()
    ]


def test_a_training_that_is_told_to_stop_is_done_and_leaves_no_process_behind(tmp_path: Path) -> None:
    command = [
        *(sys.executable, "-m", "services.toolbox", "train", "--images", "200", "--holdout", "20", "--device", "cpu"),
        *("--workers", "2", "--work-dir", str(tmp_path / "work"), "--output", str(tmp_path / "my.pt")),
    ]
    (tmp_path / "sitecustomize.py").write_text(SLOW_BEGINNING)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path.cwd())])}
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=environment) as running:
        wait_until(lambda: len(begun_by(running.pid)) >= 3)  # one keeps books for the others
        began = begun_by(running.pid)
        running.send_signal(signal.SIGTERM)
        _, said = running.communicate(timeout=60)
    alive = [pid for pid in began if runs(pid)]
    assert running.returncode == 128 + signal.SIGTERM
    assert b"exiting at once" not in said
    assert b"leaked" not in said
    assert len(alive) <= 1  # that one, which notices at its own pace
    wait_until(lambda: not any(map(runs, began)))


async def test_what_nobody_corrected_is_told_before_anything_is_done(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder_with(tmp_path / "site", {"a_1": "", "a_2": "", "a_3": ""})
    lines = (f'{{"file": "train/images/a_{number}.jpg", "drafts_by": "m"}}\n' for number in (1, 2))
    (tmp_path / "site/collected.jsonl").write_text("".join(lines))
    (tmp_path / "file").touch()
    settings = TrainingSettings(
        data=[tmp_path / "site"], output=tmp_path / "file" / "my.pt", work_dir=tmp_path / "work"
    )
    with pytest.raises(TrainingError, match="--output"):
        await run(settings, open_weights, REFINEMENT)
    (line,) = [each.getMessage() for each in caplog.records if each.name == "services.training.process"]
    assert line.startswith(f"{tmp_path}/site: of 3 pictures 2 have drafts of labels that nobody corrected;")
