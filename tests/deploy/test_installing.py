"""What the units and the page on upgrading say of how to install."""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from packaging.requirements import Requirement

from tests.deploy.support.units import DEPLOY, command

ROOT: Final = DEPLOY.parent
UPGRADING: Final = ROOT / "docs" / "upgrading.md"
GATEWAY: Final = DEPLOY / "fleetsight-gateway.service"
SPACE: Final = DEPLOY / "fleetsight-space@.service"


def commands(file: Path) -> Iterator[list[str]]:
    """Yield the words, without quotes, of each command in a unit's comment or a page, and of what looks like one."""
    for line in file.read_text(encoding="utf-8").splitlines():
        if line.startswith(("#   ", "    ")) and (words := line.removeprefix("#").replace("'", "").split()):
            yield words


def environment(file: Path) -> list[list[str]]:
    """Return the commands that make an environment anew, as a robot's is made."""
    found = list(commands(file))
    first = found.index(["python3", "-m", "venv", "--clear", "/opt/fleetsight"])
    return found[first : first + 3]


def extras(file: Path) -> set[str]:
    _, installed, _ = environment(file)
    return Requirement(f"fleetsight{installed[-1].removeprefix('.')}").extras


@pytest.mark.parametrize("file", [SPACE, UPGRADING], ids=lambda file: file.name)
def test_what_measures_beside_the_gateway_is_installed_as_the_gateway_is_with_its_extras(file: Path) -> None:
    made, installed, removed = environment(GATEWAY)
    assert environment(file) == [made, [*installed[:-1], ".[distance,cloud,pki]"], removed]
    assert extras(file) == {command(name).extra for name in ("distance", "cloud")} | extras(GATEWAY)


def test_the_gateways_unit_says_what_to_install_where_more_is_to_be_there() -> None:
    """A robot that has a token needs `pki`, and has no pip to add it with."""
    assert extras(GATEWAY) == {"pki"}
    assert "'.[distance,cloud,pki]' where fleetsight-space@.service" in GATEWAY.read_text(encoding="utf-8")


def test_an_upgrade_stops_all_that_it_replaces_and_starts_it_again() -> None:
    words = [each[1:] for each in commands(UPGRADING) if each[0] == "systemctl"]
    robot = {"fleetsight-gateway", "fleetsight-space@distance", "fleetsight-space@cloud"}
    assert robot in [set(each[1:]) for each in words if each[0] == "stop"]
    assert robot in [set(each[1:]) for each in words if each[0] == "start"]


def run(line: str, folder: Path, now: str) -> None:
    """Run a command of a page for a state folder below another one, at a time of our own."""
    there = line.replace("/var/lib/", f"{folder}/")
    subprocess.run(["bash", "-euc", f"date() {{ echo {now}; }}; {there}"], check=True)


@pytest.mark.parametrize("name", ["gateway", "monitor", "detector", "worldmodel"])
def test_what_debian_leaves_out_of_python_is_installed_first(name: str) -> None:
    first, second, *_ = commands(DEPLOY / f"fleetsight-{name}.service")
    assert first == ["apt-get", "install", "python3-venv"]
    assert second[:3] == ["python3", "-m", "venv"]


def test_who_became_the_units_user_calls_the_program_by_its_whole_path() -> None:
    pages = [*DEPLOY.glob("*.service"), *(ROOT / "docs").glob("*.md"), ROOT / "README.md"]
    called = [words for page in pages for words in commands(page) if words[0] in {"runuser", "sudo", "su"}]
    assert {(*words[:5], command(words[5]).name) for words in called} == {
        ("runuser", "-u", "fleetsight", "--", "/opt/fleetsight/bin/fleetsight", name)
        for name in ("doctor", "pki", "users")
    }


def test_each_upgrade_leaves_a_copy_of_its_own_and_the_way_back_brings_one_of_them(tmp_path: Path) -> None:
    lines = [line.strip() for line in UPGRADING.read_text(encoding="utf-8").splitlines()]
    copied, *back = (line for line in lines if line.startswith(("cp ", "mv ")))
    database = tmp_path / "fleetsight" / "history.db"
    database.parent.mkdir()
    for now in ("2026-11-20T060000", "2026-11-27T060000"):
        database.write_text(now)
        run(copied, tmp_path, now)
    for line in back:
        run(line, tmp_path, "2026-11-28T060000")
    assert database.read_text() == "2026-11-20T060000"
    assert {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.db")} == {
        "fleetsight/history.db",
        "fleetsight.2026-11-20T060000/history.db",
        "fleetsight.2026-11-27T060000/history.db",
        "fleetsight.2026-11-28T060000/history.db",
    }
