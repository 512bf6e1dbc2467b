"""The units and the examples of settings that lie in deploy/."""

import atexit
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from services.toolbox.command import Command
from services.toolbox.commands import COMMANDS
from services.toolbox.settings import S, load
from tests.deploy.support.certificates import make_certificates

DEPLOY = Path(__file__).parents[3] / "deploy"


def command(name: str) -> Command:
    (found,) = (each for each in COMMANDS if each.name == name)
    return found


def unit(name: str) -> list[str]:
    return (DEPLOY / f"fleetsight-{name}.service").read_text(encoding="utf-8").splitlines()


def values(name: str, setting: str) -> list[str]:
    return [line.partition("=")[2] for line in unit(name) if line.startswith(f"{setting}=")]


def example(model: type[S], name: str) -> S:
    """Return the settings of an example."""
    return settings_of(model, (DEPLOY / name).read_text(encoding="utf-8"), name)


def settings_of(model: type[S], text: str, name: str) -> S:
    """Return the settings of a file with a text, which finds its certificates where it expects them."""
    folder = _etc()
    (folder / name).write_text(text.replace("/etc/fleetsight", str(folder)), encoding="utf-8")
    return load(model, ["--config", str(folder / name)], prog="fleetsight").settings


@cache
def _etc() -> Path:
    folder = Path(mkdtemp())
    atexit.register(shutil.rmtree, folder)
    authority = make_certificates(folder, {"central": "monitor", "gpu1": "detector"})
    for file in authority.iterdir():
        if file.name != "ca.key":
            shutil.copy(file, folder)
    return folder
