from pathlib import Path

import pytest

from services.simulator.settings import SimulatorSettings
from services.toolbox.__main__ import LASTING
from services.toolbox.commands import COMMANDS

CALL = next(command for command in COMMANDS if command.name == "call")


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        ([], []),
        (["r1"], ["--robot", "r1"]),
        (["r1", "/reset"], ["--robot", "r1", "--service", "/reset"]),
        (["r1", "/reset", "--data", "true"], ["--robot", "r1", "--service", "/reset", "--data", "true"]),
        (["r1", "--service", "/reset"], ["--robot", "r1", "--service", "/reset"]),
        (["--robot", "r1", "/reset"], ["--robot", "r1", "/reset"]),
        (["r1", "/reset", "more"], ["--robot", "r1", "--service", "/reset", "more"]),
    ],
)
def test_the_first_arguments_may_go_without_their_names(arguments: list[str], options: list[str]) -> None:
    assert CALL.options_of(arguments) == options


def test_other_commands_have_options_only() -> None:
    for command in COMMANDS:
        if not command.positional:
            assert command.options_of(["r1", "--robot", "r2"]) == ["r1", "--robot", "r2"]


def test_commands_run_until_they_are_told_to_stop_or_have_an_end_of_their_own() -> None:
    assert {command.name for command in COMMANDS if command.finite is not True} == LASTING
    simulate = next(command for command in COMMANDS if command.name == "simulate")
    assert not simulate.ends(SimulatorSettings(ros_master=None))
    assert simulate.ends(SimulatorSettings(ros_master=None, bag=Path("a.bag")))
