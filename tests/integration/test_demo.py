"""`fleetsight demo` as a user runs it."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil
import pytest

from services.toolbox.process import EXIT_FAILED

DEMO = (sys.executable, "-m", "services.toolbox", "demo", "--robots", "3", "--hz", "1")
PATIENCE_S = 60


@contextmanager
def demo(*options: str, under: tuple[str, ...] = ()) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [*under, *DEMO, *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as running:
        try:
            yield running
        finally:
            running.kill()


def until_said(running: subprocess.Popen[str], pattern: str) -> None:
    assert running.stdout is not None
    assert any(re.search(pattern, line) for line in running.stdout)


def processes(running: subprocess.Popen[str]) -> list[psutil.Process]:
    """Return the demo's eight: simulator, three gateways, detector, distance, cloud and world model."""
    found = psutil.Process(running.pid).children(recursive=True)
    assert len(found) == 8
    return found


@pytest.mark.timeout(180)
def test_it_stops_by_itself_and_adds_up() -> None:
    with demo("--seconds", "25") as running:
        said, _ = running.communicate(timeout=PATIENCE_S * 2)
    assert running.returncode == 0, said
    for robot in ("r1", "r2", "r3"):
        assert re.search(rf"^{robot}/camera: online, .*(box|pallet|forklift|nothing)", said, re.MULTILINE)
    sent, inferred, under_way, lists = (
        int(number)
        for label in ("frames sent", "frames inferred", "frames under way", "class lists received")
        for number in re.findall(rf"^{label}: +(\d+)", said, re.MULTILINE)
    )
    dropped = sum(int(count) for count in re.findall(r"(\d+) (?:at the|on the)", said))
    assert inferred + dropped + under_way == sent
    assert inferred > 0
    assert under_way <= 3 * 3  # per robot: one on each of the two links, one at the model
    assert 0 < lists <= inferred
    assert re.search(r"^class lists received: .*r1 [1-9].*r2 [1-9].*r3 [1-9]", said, re.MULTILINE)
    assert re.search(r"^age p50 / p99: +[\d.]+ s / [\d.]+ s$", said, re.MULTILINE)
    assert re.search(r"^machine: .*\d+ processors, \d+% busy, [1-9]\d*% with the demo", said, re.MULTILINE)
    assert said.endswith("every robot was seen\n")
    beginning, page, seeing = said.partition("\npage: ")
    assert "is ready" not in beginning
    assert page
    assert re.search(r"is ready(?s:.*)^page: http\S+ \(log in as ", seeing, re.MULTILINE), "where people look then"
    assert "closed by the publisher" not in said  # that processes miss each other at the end is no news


@pytest.mark.timeout(120)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_everything(number: signal.Signals) -> None:
    with demo() as running:
        until_said(running, "gateway r3: .*connected")
        started = processes(running)
        running.send_signal(number)
        said, _ = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 0
    assert "frames sent:" in said
    assert "exiting at once" not in said
    assert psutil.wait_procs(started, timeout=0)[1] == []


@pytest.mark.timeout(120)
def test_it_outlives_its_terminal_under_nohup_and_says_that_the_machine_was_too_slow() -> None:
    with other_work(), demo("--seconds", "10", under=("nohup",)) as running:
        until_said(running, "connected")
        running.send_signal(signal.SIGHUP)
        said, _ = running.communicate(timeout=PATIENCE_S)
    assert running.returncode >= 0, "the signal did not end it"
    assert re.search(r"^machine: +too slow for this \(\d+ processors, (9\d|100)% busy, ", said, re.MULTILINE), said
    assert re.search(r"^result: ", said, re.MULTILINE)


@contextmanager
def other_work() -> Iterator[None]:
    """Keep every processor busy with something else."""
    with ExitStack() as stack:
        for _ in range(2 * (os.cpu_count() or 1)):
            busy = stack.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            stack.callback(busy.kill)
        yield


@pytest.mark.timeout(120)
def test_nothing_outlives_a_demo_that_is_killed() -> None:
    with demo() as running:
        until_said(running, "gateway r3: .*connected")
        started = processes(running)
        running.kill()
        _, alive = psutil.wait_procs(started, timeout=PATIENCE_S)
    assert alive == []


@pytest.mark.timeout(120)
def test_a_process_that_fails_ends_the_demo_with_its_reason(tmp_path: Path) -> None:
    model = tmp_path / "text.pt"
    model.write_text("no model")
    with demo("--model", str(model)) as running:
        said, _ = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == EXIT_FAILED
    assert "detector ended with exit code 2: fleetsight detector: --model" in said
    assert f"{model}: not a model that can be used" in said
