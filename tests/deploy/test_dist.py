"""`make dist` in a copy of the checkout: what a release has, and that it installs and starts without a checkout."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
from importlib.metadata import version
from pathlib import Path

import pytest

from deploy.release import RECORDS, is_released, notes
from tests.deploy.support.helm import helm

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the checkout would be released as: dated in its changelog, recorded, committed and tagged."""
    clone = tmp_path_factory.mktemp("release") / "fleetsight"
    shutil.copytree(ROOT, clone, symlinks=True, ignore=shutil.ignore_patterns(*NOT_COPIED))
    changelog = clone / "CHANGELOG.md"
    changelog.write_text(dated(changelog.read_text(encoding="utf-8")), encoding="utf-8")
    record = clone / RECORDS / VERSION
    record.mkdir(exist_ok=True)
    (record / "made-by-a-test").touch()
    run("git", "init", "--quiet", folder=clone)
    run("git", "add", "--all", folder=clone)
    run("git", *AUTHOR, "commit", "--quiet", "--message", "release", folder=clone)
    run("git", "tag", f"v{VERSION}", folder=clone)
    run("make", "dist", "--old-file=.venv/.test", f"BIN={Path(sys.executable).parent}", folder=clone)
    return clone / "dist"


VERSION = version("fleetsight")
NOT_COPIED = (".git", ".venv", "runs", "dist", "__pycache__", ".*_cache", ".hypothesis")
AUTHOR = ("-c", "user.name=release", "-c", "user.email=release@localhost")
INHERITED = {"PYTHONPATH", "VIRTUAL_ENV", "MAKEFLAGS"}


def dated(changelog: str) -> str:
    """Return a changelog in which what is not released yet is released as VERSION."""
    if is_released(VERSION, changelog):
        return changelog
    return re.sub(r"^## Unreleased$", f"## {VERSION} - 2026-12-01", changelog, count=1, flags=re.MULTILINE)


def run(*command: str, folder: Path | None = None) -> str:
    """Run a command as from a shell of its own; return its output, or fail with it."""
    outside = {name: value for name, value in os.environ.items() if name not in INHERITED}
    done = subprocess.run(command, cwd=folder, env=outside, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


@pytest.mark.timeout(600)
def test_everything_is_there_and_whole(dist: Path) -> None:
    names = {each.name for each in dist.iterdir()}
    assert {"constraints.txt", "CHANGELOG.md", "NOTES.md", "deploy.tar.gz", "sbom.cdx.json", "SHA256SUMS"} < names
    assert {each.suffix for each in dist.glob("fleetsight-*")} == {".whl", ".gz", ".tgz"}
    run("sha256sum", "--check", "--strict", "SHA256SUMS", folder=dist)
    assert len((dist / "SHA256SUMS").read_text().splitlines()) == len(names) - 1
    with tarfile.open(dist / "deploy.tar.gz") as deploy:
        assert {"deploy/Containerfile", "deploy/compose.yaml", "deploy/fleetsight-gateway.service"} <= set(
            deploy.getnames()
        )


@pytest.mark.timeout(600)
def test_helm_takes_the_chart(dist: Path) -> None:
    (chart,) = dist.glob("fleetsight-*.tgz")
    done = helm("template", "site", chart)
    assert done.returncode == 0, done.stderr
    assert "name: site-fleetsight-detector" in done.stdout


@pytest.mark.timeout(600)
def test_the_bill_of_materials_names_the_pinned_packages(dist: Path) -> None:
    bill = json.loads((dist / "sbom.cdx.json").read_text())
    found = {each["name"]: each["version"] for each in bill["components"]}
    pins = (line.partition("==") for line in (dist / "constraints.txt").read_text().splitlines())
    pinned = {name: pin.partition(";")[0].strip() for name, _, pin in pins}
    assert bill["bomFormat"] == "CycloneDX"
    assert found["eclipse-zenoh"] == pinned["eclipse-zenoh"]
    assert len(found) > 50


@pytest.mark.timeout(600)
def test_each_image_has_a_bill_of_materials_of_what_it_has_and_no_more(dist: Path) -> None:
    told = json.loads((dist / "images.json").read_text())
    bills = {each["target"]: each["sbom"] for each in told["images"]}
    assert set(dist.glob("sbom-*")) == {dist / bill for bill in bills.values() if bill}
    assert (bills["postgresql"], bills["prometheus"]) == (None, None)
    found = {target: packages(dist / bill) for target, bill in bills.items() if bill}
    assert set(found) == {"gateway", "space", "monitor", "detector", "detector-cpu", "simulator"}
    everywhere = {"eclipse-zenoh", "msgspec", "numpy"}
    assert all(everywhere <= set(has) and "setuptools" not in has for has in found.values())
    for name, targets in {
        "cryptography": {"gateway", "monitor"},
        "nicegui": {"monitor"},
        "rosbags": {"simulator"},
        "lapx": {"space", "detector", "detector-cpu"},
        "torch": {"detector"},
        "onnxruntime": {"detector", "detector-cpu"},
        "openvino": {"detector", "detector-cpu"},
        "pytest": set(),
    }.items():
        assert {target for target, has in found.items() if name in has} == targets, name


@pytest.mark.timeout(600)
def test_the_list_of_images_is_the_documentations(dist: Path) -> None:
    told = json.loads((dist / "images.json").read_text())
    page = (ROOT / "docs" / "containers.md").read_text(encoding="utf-8")
    table = page[page.index("| target |") : page.index("Sizes are of")]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    assert {each["target"] for each in told["images"]} == set(re.findall(r"`([a-z-]+)`", " ".join(rows)))


@pytest.mark.timeout(600)
def test_the_notes_are_this_versions(dist: Path) -> None:
    assert [each.name.split("-")[1] for each in dist.glob("*.whl")] == [VERSION]
    found = (dist / "NOTES.md").read_text(encoding="utf-8")
    assert re.match(rf"# fleetsight {re.escape(VERSION)} - \d{{4}}-\d\d-\d\d$", found.splitlines()[0])
    assert found == notes(dated((ROOT / "CHANGELOG.md").read_text(encoding="utf-8")), VERSION)


def packages(bill: Path) -> dict[str, str]:
    """Return the versions in a bill of materials, by name."""
    return {each["name"]: each["version"] for each in json.loads(bill.read_text())["components"]}


HASHED = ("--no-deps", "--require-hashes", "--requirement")


@pytest.mark.timeout(600)
def test_each_image_has_its_packages_with_hashes_and_no_address(dist: Path) -> None:
    for bill in dist.glob("sbom-*"):
        text = (dist / f"requirements-{bill.name.removeprefix('sbom-').removesuffix('.cdx.json')}.txt").read_text()
        hashed = dict(re.findall(r"^(\S+)==(\S+) \\\n    --hash=sha256:[0-9a-f]{64}", text, re.MULTILINE))
        assert hashed == {name: version.partition("+")[0] for name, version in packages(bill).items()}
        assert "://" not in text


@pytest.mark.timeout(600)
def test_a_package_that_is_not_what_was_released_is_not_installed(dist: Path, tmp_path: Path) -> None:
    text = (dist / "requirements-gateway.txt").read_text()
    of_one = re.search(r"^msgspec==.*\n(?:    --hash.*\n)+", text, re.MULTILINE)
    assert of_one is not None
    changed = tmp_path / "changed.txt"
    changed.write_text(re.sub("sha256:.", lambda found: "sha256:" + "10"[found[0][-1] == "1"], of_one[0]))
    run(sys.executable, "-m", "venv", str(tmp_path / "venv"))
    with pytest.raises(AssertionError, match=r"Got +[0-9a-f]{64}"):
        run(str(tmp_path / "venv/bin/python"), "-m", "pip", "install", "--no-cache-dir", *HASHED, str(changed))


@pytest.mark.timeout(600)
def test_the_wheel_installs_and_starts_without_a_checkout(dist: Path, tmp_path: Path) -> None:
    (wheel,) = dist.glob("*.whl")
    run(sys.executable, "-m", "venv", str(tmp_path / "venv"))
    python = str(tmp_path / "venv/bin/python")
    run(python, "-m", "pip", "install", "--quiet", *HASHED, str(dist / "requirements-gateway.txt"))
    run(python, "-m", "pip", "install", "--quiet", "--no-deps", str(wheel))
    run(python, "-m", "pip", "check")
    assert run(str(tmp_path / "venv/bin/fleetsight"), "--version", folder=tmp_path).startswith("fleetsight ")
    listed = run(python, "-m", "zipfile", "--list", str(wheel))
    assert all(f"services/detector/weights/warehouse-n-seg.{form}" in listed for form in ("pt", "onnx"))
    assert "tests/" not in listed
