"""What a release says of itself: its notes, its images, and the packages in them."""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packageurl import PackageURL
from packaging.requirements import Requirement

from deploy import release
from deploy.image_bill import bill_of_materials, find_image, python_packages
from deploy.release import RECORDS, check_pins, check_release, check_wheels, images, needed, notes
from tests.deploy.support.machine import checked, require_containers
from tests.deploy.support.podman import PREFIX, Podman, remove_abandoned

CHANGELOG = """# Changelog

## Unreleased

- later

## [0.2.0] - 2026-12-01

### Added

- this

## 0.1.0

- earlier
"""

CONTAINERFILE = """ARG PYTHON=python
FROM ${PYTHON} AS build
RUN printf /install.sh
FROM ${PYTHON} AS base
FROM build AS build-detector-cpu
RUN sh /install.sh "[detector-onnx]" && true
FROM base AS detector-cpu
COPY --from=build-detector-cpu /opt /opt
CMD ["detector"]
FROM debian AS prometheus
CMD ["prometheus"]
"""


@pytest.mark.parametrize(
    ("version", "told"),
    [
        ("0.2.0", "# fleetsight [0.2.0] - 2026-12-01\n\n### Added\n\n- this\n"),
        ("0.1.0", "# fleetsight 0.1.0\n\n- earlier\n"),
        ("0.3.0", "# fleetsight 0.3.0, not released yet\n\n- later\n"),
    ],
)
def test_notes_are_the_part_of_the_version(version: str, told: str) -> None:
    assert notes(CHANGELOG, version) == told


def test_a_version_that_the_changelog_does_not_know_is_refused() -> None:
    with pytest.raises(ValueError, match=r"no part that begins with '## 0\.2\.0'"):
        notes("# Changelog\n\n## 0.2.0rc1\n\n- it\n", "0.2.0")


def test_a_release_is_packed_from_its_tag_alone_and_with_its_record(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(release, "ROOT", tmp_path)
    (tmp_path / RECORDS / "0.2.0").mkdir(parents=True)
    for each in ("0.2.0", "0.3.0"):  # of these two the first is in the changelog
        check_release(each, CHANGELOG, changed=[], tags=["v0.1.0", "v0.2.0"])
    check_release("0.3.0", CHANGELOG, changed=["README.md"], tags=[])
    with pytest.raises(ValueError, match=r"tagged v0\.3\.0, which CHANGELOG\.md has not"):
        check_release("0.3.0", CHANGELOG, changed=[], tags=["v0.3.0"])
    with pytest.raises(ValueError, match=r"README\.md is not: commit it, or git stash"):
        check_release("0.2.0", CHANGELOG, changed=["README.md"], tags=["v0.2.0"])
    with pytest.raises(ValueError, match=r"no such tag: git tag v0\.2\.0, or check it out"):
        check_release("0.2.0", CHANGELOG, changed=[], tags=["v0.1.0"])
    with pytest.raises(ValueError, match=r"releases/0\.1\.0 is not there: python -m tests\.releases\.record"):
        check_release("0.1.0", CHANGELOG, changed=[], tags=["v0.1.0"])


def test_images_are_the_stages_that_run_something() -> None:
    assert images(CONTAINERFILE) == {"detector-cpu": ["detector-onnx"], "prometheus": None}


def test_an_image_needs_what_its_extras_need_however_far_away() -> None:
    monitor, gateway = needed(["monitor", "pki"]), needed(["pki"])
    assert gateway.items() < monitor.items()
    assert {"cryptography", "cffi", "pydantic-core", "msgspec"} <= gateway.keys()
    assert {"sqlalchemy", "greenlet", "aiohttp"} <= monitor.keys() - gateway.keys()  # aiohttp: by an extra of an extra
    assert not {"pytest", "torch", "fleetsight", "pip", "setuptools"} & monitor.keys()
    assert monitor["msgspec"] == version("msgspec")


def test_an_image_without_torch_has_none() -> None:
    without = needed(["detector-onnx"]).keys()
    assert {"onnxruntime", "lapx", "pillow"} <= without
    assert not {"torch", "ultralytics-opencv-headless", "sympy"} & without


def test_versions_that_are_not_pinned_or_others_than_pinned_are_told_with_the_cure() -> None:
    check_pins("# pins\nPyYAML==6\ntorch==2.15.0\n", {"pyyaml": "6", "torch": "2.15.0+cpu"})
    with pytest.raises(ValueError, match=r"no pin of aiohttp, which an image has: add aiohttp==3\.14\.5"):
        check_pins("PyYAML==6\n", {"pyyaml": "6", "aiohttp": "3.14.5"})
    with pytest.raises(ValueError, match=r"pyyaml 5 is installed, 6 pinned: run make \.venv/\.test"):
        check_pins("PyYAML==6\n", {"pyyaml": "5"})


def test_a_package_without_a_wheel_for_an_architecture_is_told() -> None:
    check_wheels({"onnxruntime-gpu": "1.23.0"}, "x86_64")
    with pytest.raises(RuntimeError, match=r"(?s)onnxruntime-gpu==1\.23\.0.*aarch64"):
        check_wheels({"onnxruntime-gpu": "1.23.0"}, "aarch64")


def test_what_is_not_installed_is_told_with_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(release, "_requirements", only_what_is_not_there(release._requirements))
    with pytest.raises(ValueError, match=r"nothing-of-this-name is not installed: run make \.venv/\.test"):
        needed(["pki"])


def only_what_is_not_there(
    found: Callable[[str, str], Iterator[Requirement]],
) -> Callable[[str, str], Iterator[Requirement]]:
    """Return a function by which fleetsight needs a package that is not there, and others what they need."""
    return lambda name, extra: (
        iter([Requirement("nothing-of-this-name")]) if name == "fleetsight" else found(name, extra)
    )


@pytest.fixture
def podman(monkeypatch: pytest.MonkeyPatch) -> Iterator[Podman]:
    require_containers()
    found = Podman()
    for name, value in found.environment.items():
        monkeypatch.setenv(name, value)
    try:
        yield found
    finally:
        found.close()


@pytest.mark.timeout(120)
def test_an_image_that_was_built_here_of_this_commit_is_measured(podman: Podman, tmp_path: Path) -> None:
    archive, name = tmp_path / "root.tar", "localhost/fleetsight-gateway"
    assert find_image(name, "0.2.0", "abc") is None
    checked("tar", "-cf", archive, "-C", "/usr/share", "base-files")
    labels = (f"--change=LABEL org.opencontainers.image.{each}" for each in ("version=0.2.0", "revision=abc"))
    podman.run("import", "--quiet", *labels, archive, name)
    found = find_image(name, "0.2.0", "abc")
    assert found is not None
    inspect = ("podman", "image", "inspect", "--format", "{{.Size}} {{.Id}}", name)
    size, identity = subprocess.run(inspect, capture_output=True, text=True, check=True).stdout.split()
    assert (found.size["bytes"], found.size["id"]) == (int(size), identity)
    with pytest.raises(RuntimeError, match=rf"{name}: its packages cannot be listed: .*/bin/sh"):
        found.debian_packages()
    assert find_image(name, "0.2.0", "abd") is None
    assert find_image(name, "0.1.0", "abc") is None


ABANDONING = """
from tests.deploy.support.podman import Podman
podman = Podman()
podman.run("network", "create", "abandoned")
podman.run("pod", "create", "--name=left", "--network=abandoned")
podman.run("pod", "start", "left")
print(podman.environment["CONTAINERS_CONF"], flush=True)
input()
"""


@pytest.mark.timeout(120)
def test_what_killed_tests_left_of_podman_is_taken_away_and_what_is_in_use_is_not(podman: Podman) -> None:
    """Else the name server of their networks, which has one folder on a machine, listens where no container asks."""
    require_containers()
    used = Path(podman.environment["CONTAINERS_CONF"]).parent
    with subprocess.Popen([sys.executable, "-c", ABANDONING], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        left = Path(child.stdout.readline().decode().strip()).parent
        names = Path("/run/containers/networks/aardvark-dns/abandoned")
        assert left.parent == Path(tempfile.gettempdir())
        assert left.name.startswith(PREFIX)
        remove_abandoned()
        assert " left," in names.read_text(encoding="utf-8")
        os.kill(child.pid, signal.SIGKILL)
    remove_abandoned()
    assert not left.exists()
    assert not names.exists()
    assert used.exists()


MADE = datetime(2026, 12, 1, tzinfo=UTC)


def test_a_bill_of_materials_is_valid_names_every_package_and_is_always_the_same() -> None:
    libc = PackageURL("deb", "debian", "libc6", "2.36-9+deb12u10", {"arch": "amd64", "distro": "debian-12"})
    packages = [*python_packages({"msgspec": "0.20.0"}), libc]
    text = bill_of_materials("gateway", "0.2.0", MADE, packages)
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    found = {each["purl"]: (each["name"], each["version"]) for each in json.loads(text)["components"]}
    assert found == {
        "pkg:pypi/msgspec@0.20.0": ("msgspec", "0.20.0"),
        "pkg:deb/debian/libc6@2.36-9%2Bdeb12u10?arch=amd64&distro=debian-12": ("libc6", "2.36-9+deb12u10"),
    }
    assert bill_of_materials("gateway", "0.2.0", MADE, reversed(packages)) == text
