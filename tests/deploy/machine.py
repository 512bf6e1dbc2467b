"""Whole systems made of Debian's packages: wheels to install in them, a root file system, one that systemd runs."""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

from tests.deploy.units import DEPLOY
from tests.missing import require_debian

ROOT: Final = DEPLOY.parent
DEBIAN: Final = "bookworm"
DEBIANS_PYTHON: Final = (3, 11)
TOOLS: Final = ("mmdebstrap", "systemd-nspawn", "podman", "buildah", "runc")
DEADLINE_S: Final = 60


def require_containers() -> None:
    """Skip where systems cannot be made or started here, for a reason that is no fault of the project's."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        require_debian("containers", missing, how="tests/install/containers.sh installs it")
    if subprocess.run(["unshare", "--mount", "--pid", "--fork", "true"], capture_output=True, check=False).returncode:
        pytest.skip("this machine does not let its user make namespaces: run the tests as root")
    if sys.version_info[:2] != DEBIANS_PYTHON:
        pytest.skip(f"the wheels are made with Debian's Python {'.'.join(map(str, DEBIANS_PYTHON))}")


def checked(*command: str | Path) -> str:
    """Return the output of a command; fail with it where the command fails."""
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, f"{command}: {ended.stdout[-2000:]}{ended.stderr[-4000:]}"
    return ended.stdout


def make_wheels(folder: Path, extras: str) -> Path:
    """Return a folder with wheels of fleetsight and all that it needs, to install it without network."""
    folder.mkdir()
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--wheel-dir", str(folder)]
    checked(*wheel, "--constraint", str(ROOT / "constraints.txt"), f"{ROOT}[{extras}]", "hatchling")
    return folder


def make_root(target: Path, *packages: str) -> Path:
    """Make a folder, or an archive where it is named so, of Debian's smallest root file system with some packages."""
    include = ",".join(("python3", "python3-venv", "ca-certificates", *packages))
    slim = [f"--dpkgopt=path-exclude=/usr/share/{name}/*" for name in ("doc", "info", "locale", "man")]
    checked("mmdebstrap", "--quiet", "--variant=minbase", f"--include={include}", *slim, DEBIAN, target)
    return target


class Machine:
    """A system that systemd runs, in namespaces of its own: no network but its loopback."""

    def __init__(self, leader: int) -> None:
        self._enter = ["nsenter", f"--target={leader}", "--mount", "--uts", "--ipc", "--net", "--pid", "--root"]

    def run(self, *command: str, check: bool = True) -> str:
        """Return the output of a command that is run in it."""
        ended = subprocess.run([*self._enter, *command], capture_output=True, text=True, check=False)
        assert not check or ended.returncode == 0, f"{command}: {ended.stdout}{ended.stderr}"
        return ended.stdout

    def show(self, unit: str, name: str) -> str:
        """Return a property of a unit."""
        return self.run("systemctl", "show", "--value", f"--property={name}", unit).strip()

    def log(self, unit: str) -> str:
        """Return the messages of a unit."""
        return self.run("journalctl", "--no-pager", "--output=cat", f"--unit={unit}")

    def until(self, holds: Callable[[], bool], what: str) -> None:
        """Wait until something holds."""
        end = time.monotonic() + DEADLINE_S
        while not holds():
            assert time.monotonic() < end, (
                f"{what}: {self.run('systemctl', 'status', '--no-pager', 'fleetsight-*', check=False)}"
            )
            time.sleep(0.2)


@contextmanager
def booted(tree: Path) -> Iterator[Machine]:
    """Start the system in a folder, and stop it."""
    nspawn = ["systemd-nspawn", "--quiet", "--register=no", "--keep-unit", f"--directory={tree}"]
    with subprocess.Popen(
        [*nspawn, "--boot", "--private-network", "--console=pipe"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as started:
        try:
            yield Machine(_leader(started.pid))
        finally:
            started.terminate()  # it halts the system
            try:
                started.communicate(timeout=DEADLINE_S)
            except subprocess.TimeoutExpired:
                started.kill()


def _leader(nspawn: int) -> int:
    """Return the process of the system's systemd, once it answers."""
    end = time.monotonic() + DEADLINE_S
    children = Path(f"/proc/{nspawn}/task/{nspawn}/children")
    while True:
        for leader in map(int, children.read_text(encoding="ascii").split()):
            if "active" in Machine(leader).run("systemctl", "is-active", "basic.target", check=False).split():
                return leader
        assert time.monotonic() < end, "systemd did not start"
        time.sleep(0.2)


def set_up(tree: Path, wheels: Path, script: str) -> None:
    """Run a script in a root file system, which has the project at /src and the wheels at /wheels."""
    (tree / "root" / "set-up.sh").write_text(f"set -eu\n{script}\n", encoding="utf-8")
    nspawn = ["systemd-nspawn", "--quiet", "--register=no", "--keep-unit", f"--directory={tree}"]
    bound = [f"--bind-ro={wheels}:/wheels", f"--bind-ro={ROOT}:/src"]
    environment = ["--setenv=PIP_NO_INDEX=1", "--setenv=PIP_FIND_LINKS=/wheels", "--chdir=/src"]
    checked(*nspawn, *bound, *environment, "--as-pid2", "/bin/bash", "/root/set-up.sh")
