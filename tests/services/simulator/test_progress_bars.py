import io
from itertools import pairwise

import pytest
from rich.console import Console

from services.simulator.progress_bars import EVERY_S, Lines, bar, progress


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def written(console: Console) -> list[str]:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


def test_a_line_when_a_stage_begins_now_and_then_and_when_it_is_done() -> None:
    console, clock = Console(file=io.StringIO()), Clock()
    lines = Lines(console, clock)
    for done in range(101):
        lines("train [coarse]", done, 100)
        clock.now_s += EVERY_S / 40
    assert written(console) == [
        "train [coarse]: 0 of 100",
        "train [coarse]: 40 of 100 after 0:00:15, 0:00:22 to go",
        "train [coarse]: 80 of 100 after 0:00:30, 0:00:08 to go",
        "train [coarse]: 100 of 100 after 0:00:38",
    ]


def test_every_stage_has_lines_and_times_of_its_own() -> None:
    console, clock = Console(file=io.StringIO()), Clock()
    lines = Lines(console, clock)
    for stage, done in (("render", 0), ("render", 1), ("render", 2), ("train", 600), ("train", 601), ("train", 900)):
        lines(stage, done, 900 if stage == "train" else 2)
        clock.now_s += 3600
    assert written(console) == [
        "render: 0 of 2",
        "render: 1 of 2 after 1:00:00, 1:00:00 to go",
        "render: 2 of 2 after 2:00:00",
        "train: 600 of 900",
        "train: 601 of 900 after 1:00:00, 12 days, 11:00:00 to go",
        "train: 900 of 900 after 2:00:00",
    ]


def test_off_a_terminal_progress_is_lines() -> None:
    console = Console(file=io.StringIO())
    with progress(console) as report:
        report("render", 0, 3)
        report("render", 3, 3)
    assert [line.split(" after")[0] for line in written(console)] == ["render: 0 of 3", "render: 3 of 3"]


def test_on_a_terminal_each_stage_is_a_bar() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=100)
    with progress(console) as report:
        for stage, following in pairwise(("render", "train", "evaluate")):
            report(stage, 3, 3)
            report(following, 0, 3)
    last = [line for line in written(console) if "/3" in line][-3:]
    for line, stage, done in zip(last, ("render", "train", "evaluate"), ("3/3", "3/3", "0/3"), strict=True):
        assert stage in line
        assert done in line


def test_a_bar_counts_pieces_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    with bar("writing", 2) as done:
        done()
        done()
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(" after")[0] for line in lines] == ["writing: 0 of 2", "writing: 2 of 2"]
