"""Podman with a store of its own, and images made by the Containerfile without network."""

import fcntl
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Final

import pytest

from tests.deploy.support.machine import checked, require_containers, root_archive
from tests.deploy.support.units import DEPLOY

BASE: Final = "localhost/debian"
CONFIGURATION: Final = """
[containers]
default_ulimits = ["nofile=10000:10000", "nproc=10000:10000"]
log_driver = "k8s-file"
[network]
network_backend = "netavark"
network_config_dir = "{folder}/networks"
[engine]
runtime = "runc"
cgroup_manager = "cgroupfs"
events_logger = "file"
tmp_dir = "{folder}/libpod"
"""
"""Shares no state with other podmans, whose reset would have this one forget what runs.

Runs where there is no systemd, with hybrid cgroups, and where limits cannot be raised. Only netavark has names.
"""

PREFIX: Final = "podman-"
OWNER: Final = "owner"
"""A file in a podman's folder, locked by the process that uses it; the lock ends with the process, however it ends."""

DEADLINE_S: Final = 900
PATIENCE_S: Final = 60
TRIES = 5


COMPOSE: Final = (sys.executable, "-m", "podman_compose")
SIMULATED: Final = ("--profile", "simulated")


@contextmanager
def podman_with_debian(factory: pytest.TempPathFactory, deadline_s: float = DEADLINE_S) -> Iterator["Podman"]:
    """Yield a podman that has BASE; all that it makes goes away at the end. deadline_s: for each of its commands."""
    require_containers()
    made = Podman(deadline_s)
    try:
        made.run("import", "--quiet", root_archive(factory), BASE)
        yield made
    finally:
        made.close()


class Podman:
    """Runs podman and podman-compose, with a store in a folder that it makes.

    Tests that were killed leave bridges and names, which all podmans of a machine share: it takes them away first.

    environment: has any podman use that store.
    """

    def __init__(self, deadline_s: float = DEADLINE_S) -> None:
        self._deadline_s = deadline_s
        remove_abandoned()
        # Of a long name, as pytest's folders have, conmon cannot make its sockets: each container takes 20 s more.
        self._folder = folder = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._owner = (folder / "locking").open("w", encoding="utf-8")
        fcntl.flock(self._owner, fcntl.LOCK_EX)
        (folder / "locking").rename(folder / OWNER)
        (folder / "containers.conf").write_text(CONFIGURATION.format(folder=folder), encoding="utf-8")
        storage = f'[storage]\ndriver = "overlay"\ngraphroot = "{folder}/store"\nrunroot = "{folder}/run"\n'
        (folder / "storage.conf").write_text(storage, encoding="utf-8")
        self.environment = _environment(folder)

    @property
    def _inherited(self) -> dict[str, str]:
        return {**os.environ, **self.environment}

    def run(self, *command: str | Path, program: Sequence[str] = ("podman",), **environment: str) -> str:
        """Return the output of `podman command`; fail with it where podman fails."""
        ended = subprocess.run(
            [*program, *command],
            capture_output=True,
            text=True,
            check=False,
            env={**self._inherited, **environment},
            timeout=self._deadline_s,
        )
        assert ended.returncode == 0, f"{command}: {ended.stdout[-2000:]}{ended.stderr[-4000:]}"
        return ended.stdout

    def logs(self, container: str, *options: str) -> str:
        """Return all that a container wrote."""
        command = ["podman", "logs", *options, container]
        return subprocess.run(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            env=self._inherited,
        ).stdout

    def until_said(self, container: str, said: str, *options: str) -> None:
        """Wait until a container wrote something; fail with what all wrote."""
        end = time.monotonic() + PATIENCE_S
        while said not in self.logs(container, *options):
            if time.monotonic() > end:
                names = self.run("ps", "--all", "--format={{.Names}}").split()
                told = "\n".join(f"{each}: {self.logs(each)[-2000:]}" for each in names)
                pytest.fail(f"{container} did not say {said!r}\n{told}")
            time.sleep(0.5)

    def until_passes(self, container: str, *command: str) -> None:
        """Wait until a command passes in a container, as a probe that is asked again; fail with what it says."""
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                self.run("exec", container, *command)
            except AssertionError:
                if time.monotonic() > end:
                    raise
                time.sleep(1)
            else:
                return

    def is_healthy(self, container: str) -> bool:
        """Return whether a container's health check passes."""
        try:
            self.run("healthcheck", "run", container)
        except AssertionError:
            return False
        return True

    def compose(self, *command: str, **environment: str) -> str:
        """Return the output of podman-compose with the project's file."""
        file = DEPLOY / "compose.yaml"
        return self.run("--file", file, *command, program=COMPOSE, **environment)

    @contextmanager
    def playing(self, manifests: str, network: str) -> Iterator[None]:
        """Run the pods of Kubernetes manifests in a network of their own; take them and their volumes away again."""
        file = self._folder / "manifests.yaml"
        file.write_text(manifests, encoding="utf-8")
        self.run("network", "create", network)
        try:
            self.run("play", "kube", "--network", network, file)
            yield
        finally:
            self._take_away(file, network)

    def _take_away(self, manifests: Path, network: str) -> None:
        """Remove pods, all other containers in their network, those that depend on these, and the network itself.

        A container that is started again meanwhile keeps its pod there for a moment.
        """
        self.run("play", "kube", "--down", manifests)
        for left in reversed(range(TRIES)):
            try:
                self.run("pod", "rm", "--force", "--all", "--time=1")
                beside = self.run("ps", "--all", "--quiet", f"--filter=network={network}").split()
                if beside:
                    self.run("rm", "--force", "--depend", "--time=10", *beside)
                self.run("network", "rm", network)
                break
            except AssertionError:
                if not left:
                    raise
                time.sleep(1)
        self.run("volume", "prune", "--force")

    def build(self, wheels: Path, revision: str, *services: str) -> None:
        """Make the images of all services of compose.yaml, or of some, as podman-compose makes them."""
        options = shlex.join(["--quiet", *_build_options(wheels, revision)])
        self.compose(f"--podman-build-args={options}", "--parallel=1", *SIMULATED, "build", *services)

    def build_target(self, wheels: Path, revision: str, target: str) -> None:
        """Make the image of a target of the Containerfile, and keep nothing of what is made on the way to it."""
        name = f"localhost/fleetsight-{target}"
        what = [f"--file={DEPLOY / 'Containerfile'}", f"--target={target}", f"--tag={name}", "--layers=false"]
        self.run("build", "--quiet", *_build_options(wheels, revision), *what, DEPLOY.parent)

    def once(self, image: str, *command: str, entry: str = "fleetsight") -> str:
        """Return the output of a command in a container that can write nothing and has no rights."""
        confined = ["--read-only", "--cap-drop=all", "--security-opt=no-new-privileges", "--network=none"]
        return self.run("run", "--rm", "--pull=never", *confined, f"--entrypoint={entry}", image, *command)

    def close(self) -> None:
        """Remove everything."""
        _remove(self._folder)
        self._owner.close()


def remove_abandoned() -> None:
    """Remove what the podmans of processes that ended without closing them left: containers, networks and files."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError), (folder / OWNER).open(encoding="utf-8") as owner:
            fcntl.flock(owner, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if folder.stat().st_uid == os.geteuid():
                _remove(folder)


def _remove(folder: Path) -> None:
    if all(Path(each).is_file() for each in _environment(folder).values()):  # else the machine's own would be reset
        reset = ["podman", "system", "reset", "--force"]
        environment = {**os.environ, **_environment(folder)}
        subprocess.run(reset, capture_output=True, check=False, env=environment, timeout=DEADLINE_S)
    overlay = folder / "store" / "overlay"
    if overlay.is_mount():
        checked("umount", overlay)
    shutil.rmtree(folder, ignore_errors=True)


def _environment(folder: Path) -> dict[str, str]:
    names = {"CONTAINERS_CONF": "containers.conf", "CONTAINERS_STORAGE_CONF": "storage.conf"}
    return {variable: str(folder / name) for variable, name in names.items()}


def _build_options(wheels: Path, revision: str) -> list[str]:
    """Return what `podman build` needs to make an image without network, of wheels in a folder."""
    arguments = {
        "BASE": BASE,
        "PIP_OPTIONS": "--no-index --find-links=/wheels",
        "VERSION": version("fleetsight"),
        "REVISION": revision,
    }
    here = ["--isolation=chroot", "--network=host", "--format=docker", f"--volume={wheels}:/wheels:ro"]
    return [*here, *(f"--build-arg={name}={value}" for name, value in arguments.items())]
