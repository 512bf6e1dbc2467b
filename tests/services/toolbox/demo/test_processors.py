import os
import subprocess
import sys
import time
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


def test_processors_that_this_process_may_not_use_do_not_count(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    stat = tmp_path / "stat"
    monkeypatch.setattr(processors, "_STAT", stat)
    monkeypatch.setattr(processors, "_OWN_GROUPS", tmp_path / "none")
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {1})
    stat.write_text("cpu  0 0 0 200\ncpu0 0 0 0 100\ncpu1 0 0 0 100\nintr 1\n", encoding="ascii")
    clock = ProcessorClock()
    stat.write_text("cpu  95 0 0 305\ncpu0 0 0 0 200\ncpu1 95 0 0 105\nintr 1\n", encoding="ascii")
    use = clock.use()
    assert use is not None
    assert use.count == 1
    assert use.busy == pytest.approx(0.95)


def test_a_process_that_is_bound_to_a_processor_has_one() -> None:
    code = (
        "import os, time; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))});"
        "from services.toolbox.demo.processors import ProcessorClock; clock = ProcessorClock();"
        "time.sleep(0.2); print(clock.use().count)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert float(done.stdout) <= 1


@pytest.mark.parametrize("version", [1, 2])
def test_a_container_that_has_used_up_its_quota_is_busy_while_the_machine_is_idle(
    version: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stat, own, tree = tmp_path / "stat", tmp_path / "cgroup", tmp_path / "groups"
    folder = tree / "pod" if version == 2 else tree / "cpu" / "pod"
    inner = folder / "demo"
    inner.mkdir(parents=True)
    own.write_text("0::/pod/demo\n" if version == 2 else "4:memory:/else\n1:cpu,cpuacct:/pod/demo\n0::/\n")

    def use_quota(seconds: float) -> None:
        if version == 2:
            (inner / "cpu.max").write_text("max 100000\n")
            (folder / "cpu.max").write_text("50000 100000\n")
            (folder / "cpu.stat").write_text(f"usage_usec {round(seconds * 1e6)}\nuser_usec 1\n")
            return
        for name, value in (("cfs_quota_us", 50_000), ("cfs_period_us", 100_000)):
            (folder / f"cpu.{name}").write_text(f"{value}\n")
        (folder / "cpuacct.usage").write_text(f"{round(seconds * 1e9)}\n")

    monkeypatch.setattr(processors, "_STAT", stat)
    monkeypatch.setattr(processors, "_OWN_GROUPS", own)
    monkeypatch.setattr(processors, "_GROUPS", tree)
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {0, 1, 2, 3})
    now_s = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    stat.write_text("cpu  0 0 0 4000\n", encoding="ascii")
    use_quota(7)
    clock = ProcessorClock()
    now_s[0] += 10
    stat.write_text("cpu  490 0 0 7510\n", encoding="ascii")
    use_quota(11.9)
    use = clock.use()
    assert use is not None
    assert use.count == 0.5
    assert use.busy == pytest.approx(0.98)
    assert str(use).startswith("too slow for this (0.5 processors, 98% busy, ")


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
