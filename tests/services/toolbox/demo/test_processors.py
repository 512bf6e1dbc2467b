import subprocess
import sys
from pathlib import Path

import pytest

from services.toolbox.demo import processors
from services.toolbox.demo.processors import ProcessorClock, ProcessorUse


def test_busy_is_whatever_is_not_idle_and_own_what_this_process_and_those_that_it_started_took(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stat = tmp_path / "stat"
    monkeypatch.setattr(processors, "_STAT", stat)
    stat.write_text("cpu  100 0 50 1000 50 0 0 0 0 0\ncpu0 1 2 3\n", encoding="ascii")
    clock = ProcessorClock()
    assert clock.use() is None  # no time has gone by
    stat.write_text("cpu  400 100 150 1200 150 50 30 70 0 0\ncpu0 1 2 3\n", encoding="ascii")
    use = clock.use()
    assert use is not None
    assert use.busy == pytest.approx(650 / 950)
    assert 0 <= use.own < 1


def test_processes_that_it_started_count_as_its_own() -> None:
    before = ProcessorClock()
    subprocess.run([sys.executable, "-c", "sum(range(20_000_000))"], check=True)
    use = before.use()
    assert use is not None
    assert 0 < use.own <= use.busy + 0.1
    assert use.count >= 1


def test_where_the_system_does_not_tell_nothing_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(processors, "_STAT", tmp_path / "none")
    assert ProcessorClock().use() is None


@pytest.mark.parametrize(("busy", "slow"), [(0.5, False), (0.89, False), (0.9, True), (1.0, True)])
def test_a_machine_is_too_slow_where_work_waits(busy: float, slow: bool) -> None:  # noqa: FBT001 - a table
    assert str(ProcessorUse(4, busy, 0.4)).startswith("too slow") is slow
