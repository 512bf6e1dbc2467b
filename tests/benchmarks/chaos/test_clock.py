"""A clock that some processes alone have."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.chaos import clock

NS = 1_000_000_000
HOUR_S = 3_600
READ = """
import sys, time

for line in sys.stdin:
    print(time.time_ns(), time.monotonic_ns(), flush=True)
"""


def test_a_process_that_runs_has_a_stepped_clock_at_once_and_its_monotonic_clock_as_before(tmp_path: Path) -> None:
    environment = {**os.environ, **clock.make(tmp_path)}
    command = [sys.executable, "-c", READ]
    with subprocess.Popen(
        command, env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        read = []
        for ahead_s in (0, HOUR_S, -HOUR_S):
            clock.step(tmp_path, ahead_s * NS)
            process.stdin.write("\n")
            process.stdin.flush()
            shown_ns, steady_ns = map(int, process.stdout.readline().split())
            read.append((shown_ns - steady_ns) / NS)
    first, ahead, behind = read
    assert ahead - first == pytest.approx(HOUR_S, abs=1)
    assert behind - first == pytest.approx(-HOUR_S, abs=1)
