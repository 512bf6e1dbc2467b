"""The units and the examples of settings that lie in deploy/."""

from pathlib import Path

from services.toolbox.command import Command
from services.toolbox.commands import COMMANDS
from services.toolbox.settings import S, load

DEPLOY = Path(__file__).parents[2] / "deploy"


def command(name: str) -> Command:
    (found,) = (each for each in COMMANDS if each.name == name)
    return found


def unit(name: str) -> list[str]:
    return (DEPLOY / f"fleetsight-{name}.service").read_text(encoding="utf-8").splitlines()


def values(name: str, setting: str) -> list[str]:
    return [line.partition("=")[2] for line in unit(name) if line.startswith(f"{setting}=")]


def example(model: type[S], name: str) -> S:
    return load(model, ["--config", str(DEPLOY / name)], prog="fleetsight").settings
