"""What a robot installs, the gateway and the command line, with what gets and renews certificates, stays small.

As deploy/fleetsight-gateway.service says: pip compiles nothing and is not left there.
"""

import tomllib
from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
MAX_BYTES = 142_000_000
"""125 MB without the extra `pki`."""

COMPILED = ".pyc"
UNIT = ROOT / "deploy" / "fleetsight-gateway.service"


def installed_with(requirement: Requirement, done: set[tuple[str, frozenset[str]]]) -> Iterator[str]:
    """Yield the distributions that a requirement brings with it, itself included, some of them twice."""
    name, extras = canonicalize_name(requirement.name), frozenset(requirement.extras)
    if (name, extras) in done:
        return
    done.add((name, extras))
    yield name
    for needed in map(Requirement, distribution(name).requires or []):
        if needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in {"", *extras}):
            yield from installed_with(needed, done)


def size_of_distribution(name: str) -> int:
    files = distribution(name).files
    assert files, f"{name} does not say what it installed"
    return sum(file.size or 0 for file in files if file.suffix != COMPILED)


def size_of_own(packages: list[str]) -> int:
    files = (file for package in packages for file in (ROOT / package).rglob("*"))
    return sum(file.stat().st_size for file in files if file.is_file() and file.suffix != COMPILED)


def test_what_a_robot_installs_is_small() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    done: set[tuple[str, frozenset[str]]] = set()
    wanted = [*declared["project"]["dependencies"], *declared["project"]["optional-dependencies"]["pki"]]
    names = {name for each in wanted for name in installed_with(Requirement(each), done)}
    sizes = {name: size_of_distribution(name) for name in names}
    sizes["ours"] = size_of_own(declared["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"])
    assert {"numpy", "pydantic-core", "cryptography"} < sizes.keys()
    assert min(sizes.values()) > 0
    assert sum(sizes.values()) <= MAX_BYTES, sorted(sizes.items(), key=lambda item: -item[1])


def test_it_is_installed_without_what_is_not_counted() -> None:
    (made, installed, removed) = (
        line.removeprefix("#").split()
        for line in UNIT.read_text(encoding="utf-8").splitlines()
        if "/opt/fleetsight" in line and line.startswith("#   ")
    )
    assert made == ["python3", "-m", "venv", "--clear", "/opt/fleetsight"]
    assert installed[1:] == ["install", "--no-compile", "-c", "constraints.txt", "'.[pki]'"]
    assert removed[1:] == ["uninstall", "--yes", "pip", "setuptools"]
