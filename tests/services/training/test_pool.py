import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from services.training import parallel

JOBS = 200
LASTS_S = 0.05


def work(file: Path) -> None:
    """Take a while; leave a file with this process's number behind."""
    time.sleep(LASTS_S)
    file.write_text(str(os.getpid()))


def jobs(folder: Path) -> list[Path]:
    return [folder / str(number) for number in range(JOBS)]


@pytest.mark.parametrize("workers", [1, 2])
def test_every_job_is_done_and_reported(tmp_path: Path, workers: int) -> None:
    reported: list[int] = []
    parallel.run(work, jobs(tmp_path)[:6], workers, reported.append)
    assert reported == [1, 2, 3, 4, 5, 6]
    assert (os.getpid() in pids(tmp_path)) is (workers == 1)


@pytest.mark.parametrize("workers", [1, 2])
def test_after_an_interruption_nothing_more_begins(tmp_path: Path, workers: int) -> None:
    def interrupt(done: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        parallel.run(work, jobs(tmp_path), workers, interrupt)
    assert len(list(tmp_path.iterdir())) < JOBS / 2


SCRIPT = """
import sys
from pathlib import Path
from services.training import parallel
from tests.services.training.test_pool import jobs, work

if __name__ == "__main__":
    parallel.run(work, jobs(Path(sys.argv[1])), 2, lambda done: None)
"""


def test_no_process_outlives_whoever_began_it(tmp_path: Path) -> None:
    folder, script = tmp_path / "made", tmp_path / "run.py"
    folder.mkdir()
    script.write_text(SCRIPT)
    environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
    with subprocess.Popen([sys.executable, str(script), str(folder)], env=environment) as running:
        wait_until(lambda: pids(folder))
        running.kill()
    wait_until(lambda: not any(map(runs, pids(folder))))


def pids(folder: Path) -> set[int]:
    return {int(text) for file in folder.iterdir() if (text := file.read_text())}


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def wait_until(condition: Callable[[], object]) -> None:
    last = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < last
        time.sleep(0.05)
