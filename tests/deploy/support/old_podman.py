"""Podman 3.0 of Debian 11, with its runc and its libseccomp, of the age of a robot's Ubuntu 20.04.

It has a root of its own, and runs in namespaces of its own, with the machine's kernel and network.
"""

import json
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from tests.deploy.support.machine import checked

DEBIAN: Final = "bullseye"
PACKAGES: Final = "podman,runc,conmon,golang-github-containers-common,dash,bash,coreutils,mount,util-linux,libc-bin"
PROFILE: Final = Path("/usr/share/containers/seccomp.json")
"""What the tests' own podman allows; Debian's golang-github-containers-common has it."""

REFUSING: Final = "refusing.json"
ENTER: Final = """
set -eu
mount --bind "$1" "$1" && cd "$1"
for each in dev proc sys sys/fs/cgroup; do mount --rbind "/$each" "$each"; done
mount -t proc proc proc
for each in run tmp dev/shm; do mount -t tmpfs tmpfs "$each"; done  # shm has the locks of the machine's podman
pivot_root . mnt && cd / && umount --lazy /mnt
shift
exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin "$@"
"""

PODMAN: Final = ("podman", "--runtime=/usr/sbin/runc", "--cgroup-manager=cgroupfs", "--events-backend=none")
CONFINED: Final = ("--read-only", "--tmpfs=/tmp", "--cap-drop=all", "--network=host", "--no-healthcheck")
LIMITS: Final = ("--ulimit=nofile=1000:1000", "--ulimit=nproc=1000:1000", "--log-driver=k8s-file")


class OldPodman:
    """Runs images under it, for which it needs a folder that is not there yet."""

    def __init__(self, tree: Path) -> None:
        checked("mmdebstrap", "--quiet", "--variant=extract", f"--include={PACKAGES}", DEBIAN, tree)
        for name in ("dev", "proc", "sys", "run", "tmp", "mnt", "srv"):
            (tree / name).mkdir(exist_ok=True)
        (tree / "etc/hosts").touch()
        policy = {"default": [{"type": "insecureAcceptAnything"}]}
        (tree / "srv/policy.json").write_text(json.dumps(policy), encoding="utf-8")
        (tree / "srv" / REFUSING).write_text(json.dumps(as_docker_before_20_10_10()), encoding="utf-8")
        self._tree = tree

    def load(self, archive: Path) -> None:
        """Take an image, an archive as `docker save` writes it."""
        shutil.move(archive, self._tree / "srv/image.tar")
        done = self._run("load", "--quiet", "--signature-policy=/srv/policy.json", "--input=/srv/image.tar")
        assert done.returncode == 0, done.stderr

    def run(self, *command: str) -> "subprocess.CompletedProcess[str]":
        """Run a container, with no rights and nothing to write to but /tmp."""
        return self._run("run", "--rm", *CONFINED, *LIMITS, *command)

    @contextmanager
    def running(self, *command: str) -> Iterator[None]:
        """Run such a container until the context ends."""
        log = self._tree / "srv/running.log"
        with (
            log.open("w") as file,
            subprocess.Popen(
                [*self._apart, "run", "--rm", *CONFINED, *LIMITS, *command], stdout=file, stderr=subprocess.STDOUT
            ) as started,
        ):
            try:
                yield
            except BaseException as error:
                error.add_note(log.read_text(encoding="utf-8"))
                raise
            finally:
                started.kill()  # and with it all in its namespace

    @property
    def _apart(self) -> list[str]:
        alone = ["unshare", "--mount", "--pid", "--fork", "--kill-child"]
        return [*alone, "bash", "-c", ENTER, "bash", str(self._tree), *PODMAN]

    def _run(self, *command: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run([*self._apart, *command], capture_output=True, text=True, check=False)


def as_docker_before_20_10_10() -> dict[str, Any]:
    """Return a profile that refuses clone3 as Docker's did: with EPERM, after which the C library tries no other."""
    profile: dict[str, Any] = json.loads(PROFILE.read_text(encoding="utf-8"))
    allowed = [each for each in profile["syscalls"] if each["action"] == "SCMP_ACT_ALLOW"]
    assert any("clone3" in each["names"] for each in allowed)
    without = [{**each, "names": [name for name in each["names"] if name != "clone3"]} for each in allowed]
    return {**profile, "defaultErrnoRet": 1, "defaultErrno": "EPERM", "syscalls": without}
