import io

import pytest
from rich.console import Console

from benchmarks.running.display import display


def shown(*, terminal: bool) -> str:
    console = Console(file=io.StringIO(), force_terminal=terminal, width=100)
    with display(console, 2) as seen:
        seen.begin("gateway")
        seen.says("[1/3] flat out")
        seen.ended("2 of 3 targets met")
        seen.begin("scaling")
        seen.ended("failed: [no router]")
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_without_a_terminal_everything_is_a_line() -> None:
    assert shown(terminal=False).splitlines() == [
        "[1/2] gateway",
        "  gateway: [1/3] flat out",
        "  gateway: 2 of 3 targets met",
        "[2/2] scaling",
        "  scaling: failed: [no router]",
    ]


@pytest.mark.parametrize("words", ["gateway: 2 of 3 targets met", "scaling: failed: [no router]", "benchmarks", "2/2"])
def test_on_a_terminal_there_are_bars_and_what_ended_stands_above(words: str) -> None:
    assert words in shown(terminal=True)
