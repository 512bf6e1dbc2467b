"""Whole systems made of Debian's packages: wheels to install in them, a root file system, one that systemd runs."""

import fcntl
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import pytest

from tests.deploy.support.units import DEPLOY
from tests.missing import missing, require_debian

ROOT: Final = DEPLOY.parent
DEBIAN: Final = "bookworm"
DEBIANS_PYTHON: Final = (3, 11)
TOOLS: Final = ("mmdebstrap", "systemd-nspawn", "podman", "buildah", "runc")
OWN_CGROUP: Final = """
set -eu
for root in /sys/fs/cgroup/systemd /sys/fs/cgroup/unified /sys/fs/cgroup; do
    [ -e "$root/cgroup.procs" ] || continue
    mkdir "$root/fleetsight-$$"
    echo $$ >"$root/fleetsight-$$/cgroup.procs"
done
exec "$@"
"""
"""Shell commands that start others in a control group of their own.

Two systems in the same one have their units' processes in the same groups, of which each sees the other's as 0.
"""

NSPAWN: Final = ("systemd-nspawn", "--quiet", "--register=no", "--keep-unit")
DEADLINE_S: Final = 60

EXTRAS: Final = "cloud,detector-onnx,distance,monitor,pki,simulator,worldmodel"
"""Extras whose wheels are made, for all systems at once."""


def require_containers() -> None:
    """Skip, or fail in CI, where systems cannot be made or started here."""
    lacking = [tool for tool in TOOLS if shutil.which(tool) is None]
    if lacking:
        require_debian("containers", lacking, how="tests/install/containers.sh installs it")
    if subprocess.run(["unshare", "--mount", "--pid", "--fork", "true"], capture_output=True, check=False).returncode:
        missing("this machine does not let its user make namespaces: run the tests as root")
    if sys.version_info[:2] != DEBIANS_PYTHON:
        debians = ".".join(map(str, DEBIANS_PYTHON))
        missing(
            f"the wheels are made with Debian's Python {debians}, not with {sys.version.split()[0]}: make PYTHON=..."
        )


def checked(*command: str | Path) -> str:
    """Return the output of a command; fail with it where the command fails."""
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, f"{command}: {ended.stdout[-2000:]}{ended.stderr[-4000:]}"
    return ended.stdout


def wheels(factory: pytest.TempPathFactory, extras: str = EXTRAS) -> Path:
    """Return a folder with wheels of fleetsight with extras and all that it needs, to install it without network."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--constraint", str(ROOT / "constraints.txt")]
    asked = [f"{ROOT}[{extras}]", "hatchling"]
    return _once(factory, f"wheels-{extras}", lambda made: checked(*command, "--wheel-dir", made, *asked))


def root_archive(factory: pytest.TempPathFactory) -> Path:
    """Return an archive of Debian's smallest root file system with Python, without its venv."""
    slim = [f"--dpkgopt=path-exclude=/usr/share/{name}/*" for name in ("doc", "info", "locale", "man")]
    command = ["mmdebstrap", "--quiet", "--variant=minbase", "--include=python3,ca-certificates", *slim]
    return _once(factory, "root.tar", lambda made: checked(*command, DEBIAN, made))


def make_root(target: Path, archive: Path, *packages: str) -> Path:
    """Make a folder of a root file system's archive, with some more packages of Debian's."""
    target.mkdir()
    checked(
        "tar", "--extract", "--preserve-permissions", "--numeric-owner", f"--file={archive}", f"--directory={target}"
    )
    proxies = [f"--setenv={name}" for name in os.environ if name.lower().endswith("_proxy")]
    install = f"apt-get --quiet update && apt-get --quiet --yes --no-install-recommends install {' '.join(packages)}"
    in_it = [*NSPAWN, f"--directory={target}", *proxies, "--setenv=DEBIAN_FRONTEND=noninteractive", "--as-pid2"]
    checked(*in_it, "/bin/sh", "-c", f"{install} && apt-get clean")
    return target


def _once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Return what the first of the test run's processes makes; the others wait for it."""
    base = factory.getbasetemp()
    folder = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    made, unfinished = folder / name, folder / f"unfinished-{name}"
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            make(unfinished)
            unfinished.rename(made)
    return made


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

    def until(self, holds: Callable[[], bool], what: str, *, every_s: float = 0.2) -> None:
        """Wait until something holds, which is looked at now and then."""
        end = time.monotonic() + DEADLINE_S
        while not holds():
            assert time.monotonic() < end, (
                f"{what}: {self.run('systemctl', 'status', '--no-pager', 'fleetsight-*', check=False)}"
            )
            time.sleep(every_s)


@contextmanager
def booted(tree: Path) -> Iterator[Machine]:
    """Start the system in a folder, and stop it."""
    boot = [*NSPAWN, f"--directory={tree}", "--boot", "--private-network", "--console=pipe"]
    with subprocess.Popen(
        ["sh", "-c", OWN_CGROUP, "sh", *boot],
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
    for group in Path("/sys/fs/cgroup").glob(f"**/fleetsight-{started.pid}"):
        for folder, _, _ in os.walk(group, topdown=False):
            with suppress(OSError):  # something in it has not quite ended; an empty group harms nobody
                Path(folder).rmdir()


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
    bound = [f"--bind-ro={wheels}:/wheels", f"--bind-ro={ROOT}:/src"]
    environment = ["--setenv=PIP_NO_INDEX=1", "--setenv=PIP_FIND_LINKS=/wheels", "--chdir=/src"]
    checked(*NSPAWN, f"--directory={tree}", *bound, *environment, "--as-pid2", "/bin/bash", "/root/set-up.sh")
