"""What a release says of itself: `python -m deploy.release dist`, which `make dist` runs.

Writes into the folder: NOTES.md, this version's part of CHANGELOG.md; images.json, the Containerfile's targets; and of
each image with fleetsight in it sbom-TARGET.cdx.json, its bill of materials, and requirements-TARGET.txt, its packages
for pip with the hashes of all files that the package index has of them. Bills have Debian's packages, too, of images
that podman or Docker has here.
"""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from deploy.image_bill import bill_of_materials, find_image, python_packages

ROOT: Final = Path(__file__).parents[1]
UNRELEASED: Final = "Unreleased"
RECORDS: Final = "tests/releases"
ARCHITECTURES: Final = ("x86_64", "aarch64")
"""Of machines that images are for."""

UNINSTALLED: Final = ("setuptools",)
"""What images are rid of though packages ask for it."""


def notes(changelog: str, version: str) -> str:
    """Return the part of the changelog that is about a version, or about what follows the last one.

    Raises:
        ValueError: there is neither.
    """
    parts = {
        heading.strip("[] ").partition("]")[0].partition(" ")[0]: (heading, text.strip())
        for heading, text in re.findall(r"^## (.+?)$(.*?)(?=^## |\Z)", changelog, re.MULTILINE | re.DOTALL)
    }
    if version in parts:
        heading, text = parts[version]
        return f"# fleetsight {heading}\n\n{text}\n"
    if UNRELEASED in parts:
        return f"# fleetsight {version}, not released yet\n\n{parts[UNRELEASED][1]}\n"
    raise ValueError(f"CHANGELOG.md has no part that begins with '## {version}' or '## {UNRELEASED}': add one")


def images(containerfile: str) -> dict[str, list[str] | None]:
    """Return the extras that each target installs, by target; None of those without fleetsight."""
    stages = {
        name: (base, text)
        for base, name, text in re.findall(
            r"^FROM (\S+) AS (\S+)$(.*?)(?=^FROM |\Z)", containerfile, re.MULTILINE | re.DOTALL
        )
    }
    extras = {
        name.removeprefix("build-"): found[1].split(",")
        for name, (base, text) in stages.items()
        if base == "build" and (found := re.search(r'/install\.sh "\[([a-z,-]+)\]"', text))
    }
    return {name: extras.get(name) for name, (_, text) in stages.items() if re.search(r"^CMD ", text, re.MULTILINE)}


def needed(extras: Iterable[str]) -> dict[str, str]:
    """Return the versions of what fleetsight with some extras needs, as this environment has it, by canonical name.

    Raises:
        ValueError: something of it is not installed.
    """
    todo = [Requirement(f"fleetsight[{','.join(extras)}]")]
    seen: set[tuple[str, str]] = set()
    while todo:
        wanted = todo.pop()
        name = canonicalize_name(wanted.name)
        for extra in {"", *wanted.extras} - {extra for other, extra in seen if other == name}:
            seen.add((name, extra))
            todo += _requirements(name, extra)
    names = sorted({name for name, _ in seen}.difference(("fleetsight", *UNINSTALLED)))
    return {name: distribution(name).version for name in names}


def _requirements(name: str, extra: str) -> Iterator[Requirement]:
    try:
        asked = distribution(name).requires or ()
    except PackageNotFoundError as error:
        raise ValueError(f"{name} is not installed: run make .venv/.test") from error
    for each in map(Requirement, asked):
        if each.marker is None or each.marker.evaluate({"extra": extra}):
            yield each


def check_pins(constraints: str, packages: Mapping[str, str]) -> None:
    """Check that the versions of packages are those that are tested together.

    Raises:
        ValueError: a package has another one, or no pin.
    """
    pins = (line.partition("==") for line in constraints.splitlines() if "==" in line)
    pinned: dict[str, str] = {canonicalize_name(name): version.strip() for name, _, version in pins}
    for name, version in packages.items():
        if name not in pinned:
            raise ValueError(
                f"constraints.txt has no pin of {name}, which an image has: add {name}=={version}, test it"
            )
        if version.partition("+")[0] != pinned[name]:
            raise ValueError(f"{name} {version} is installed, {pinned[name]} pinned: run make .venv/.test")


def hashed(packages: Mapping[str, str]) -> dict[str, str]:
    """Return a line of pip's requirements for each package: its version, and the hashes of its files, by name.

    Raises:
        RuntimeError: the package index cannot be had, or has no such version.
    """
    plain = ("--no-header", "--no-annotate", "--no-emit-index-url", "--no-emit-find-links")
    told = _compiled(packages, "--generate-hashes", *plain)
    lines = re.findall(r"^(\S+)==((?:.*\\\n)*.*\n)", told, re.MULTILINE)
    return {canonicalize_name(name): f"{name}=={rest}" for name, rest in lines}


def check_wheels(packages: Mapping[str, str], architecture: str) -> None:
    """Check that packages can be installed on a processor's architecture without a compiler, on Debian 12's Python.

    Raises:
        RuntimeError: the package index has no wheel of one of them, or cannot be had.
    """
    _compiled(
        packages, "--only-binary=:all:", f"--python-platform={architecture}-manylinux_2_36", "--python-version=3.11"
    )


def _compiled(packages: Mapping[str, str], *options: str) -> str:
    command = ("uv", "pip", "compile", "--quiet", "--no-config", "--native-tls", "--no-deps", *options)
    pins = "".join(f"{name}=={version}\n" for name, version in packages.items())
    return _output(sys.executable, "-m", *command, "-", given=pins)


def is_released(version: str, changelog: str) -> bool:
    """Return whether a changelog has a part about a version."""
    return re.search(rf"^## \[?{re.escape(version)}(\]|\s|$)", changelog, re.MULTILINE) is not None


def check_release(version: str, changelog: str, *, changed: Sequence[str], tags: Sequence[str]) -> None:
    """Check that what is packed is the release that the changelog says; before that, nothing is asked for.

    changed: files that are not as they were committed. tags: those of the commit that is packed.

    Raises:
        ValueError: it is not.
    """
    if not is_released(version, changelog):
        if f"v{version}" in tags:
            raise ValueError(
                f"this commit is tagged v{version}, which CHANGELOG.md has not: it still has '{UNRELEASED}'"
            )
        return
    if changed:
        raise ValueError(f"{version} is to be what was committed, but {changed[0]} is not: commit it, or git stash")
    if f"v{version}" not in tags:
        raise ValueError(
            f"CHANGELOG.md has {version}, and this commit no such tag: git tag v{version}, or check it out"
        )
    if not (ROOT / RECORDS / version).is_dir():
        raise ValueError(f"{RECORDS}/{version} is not there: python -m tests.releases.record, commit, and tag that")


def _git(*command: str) -> list[str]:
    return _output("git", "-C", str(ROOT), *command).splitlines()


def _output(*command: str, given: str = "") -> str:
    ended = subprocess.run(command, input=given, capture_output=True, text=True, check=False)  # noqa: S603 - made here
    if ended.returncode:
        raise RuntimeError(f"{' '.join(command)}: {ended.stderr.strip()}")
    return ended.stdout


def main(folder: Path) -> None:
    """Write all of it into a folder."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    changed, tags = _git("status", "--porcelain"), _git("tag", "--points-at", "HEAD")
    check_release(version, changelog, changed=[line[3:] for line in changed], tags=tags)
    revision, committed = _git("log", "-1", "--format=%H%n%cI")
    (folder / "NOTES.md").write_text(notes(changelog, version), encoding="utf-8")
    found = images((ROOT / "deploy" / "Containerfile").read_text(encoding="utf-8"))
    packages = {target: needed(extras) for target, extras in found.items() if extras}
    everything = {name: version.partition("+")[0] for each in packages.values() for name, version in each.items()}
    check_pins((ROOT / "constraints.txt").read_text(encoding="utf-8"), everything)
    for architecture in ARCHITECTURES:
        check_wheels(everything, architecture)
    lines = hashed(everything)
    listed = []
    for target, extras in found.items():
        name = f"localhost/fleetsight-{target}"
        image = find_image(name, version, revision)
        has = [*python_packages(packages.get(target, {})), *(image.debian_packages() if image else ())]
        bill = f"sbom-{target}.cdx.json" if has else None
        if bill:
            text = bill_of_materials(target, version, datetime.fromisoformat(committed), has)
            (folder / bill).write_text(text, encoding="utf-8")
        if extras:
            (folder / f"requirements-{target}.txt").write_text("".join(lines[each] for each in packages[target]))
        here = image and image.size
        listed.append({"target": target, "image": name, "extras": extras, "sbom": bill, "built": here})
    described = json.dumps({"version": version, "revision": revision, "images": listed}, indent=2)
    (folder / "images.json").write_text(f"{described}\n", encoding="utf-8")


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]))
    except (RuntimeError, ValueError) as error:
        sys.exit(f"release: {error}")
