"""The bundle for robots with an old Python, in a system of Debian 11's packages: glibc 2.31, systemd, no Python."""

import hashlib
import shutil
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from fleetsight.own_packages import ALL
from tests.deploy.support.machine import ROOT, Machine, booted, checked, require_containers
from tests.deploy.support.seeing import seeing, simulator
from tests.fleetsight.workspaces import decoys

pytestmark = pytest.mark.timeout(600)  # the bundle and a system are made first

OLD_DEBIAN: Final = "bullseye"
IN_IT: Final = "systemd-sysv,dbus,dash,bash,coreutils,passwd,util-linux,base-passwd,libc-bin,libpam-runtime,login"
HOME: Final = "/opt/fleetsight"
PROGRAM: Final = f"{HOME}/bin/fleetsight"
WORKSPACE: Final = "/opt/ros"
SOURCED: Final = (
    f"PYTHONPATH={WORKSPACE} PYTHONHOME={WORKSPACE} LD_LIBRARY_PATH={WORKSPACE}/lib LANG=en_US.UTF-8"
    f" OPENSSL_CONF={WORKSPACE}/no.cnf"
)
OF_EXTRAS: Final = {"cv2", "opencv_python_headless"}
NOT_COPIED: Final = (".venv", "runs", "dist", "__pycache__", ".*_cache", ".hypothesis")
OF_ITS_OWN: Final = ("libz.so.1", "libm.so.6", "libexpat.so.1", "libstdc++.so.6", "libssl.so.3", "libffi.so.8")


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All that a robot may have: the gateway, and the services beside it."""
    require_containers()
    folder = tmp_path_factory.mktemp("bundle")
    command = ("env", f"PYTHON={sys.executable}", f"TMPDIR={folder}", ROOT / "deploy/bundle.sh")
    checked(*command, "pki,distance,cloud", folder)
    (made,) = folder.glob("fleetsight-gateway-*.tar.gz")
    return made


@pytest.fixture(scope="module")
def smaller(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The gateway alone, as `make bundle` makes it of a copy, for a user with another time zone and closed files."""
    require_containers()
    copy = tmp_path_factory.mktemp("copy") / "fleetsight"
    shutil.copytree(ROOT, copy, symlinks=True, ignore=shutil.ignore_patterns(*NOT_COPIED))
    make = f"umask 077 && exec make bundle --old-file=.venv/.dist BIN={Path(sys.executable).parent}"
    checked("env", "--chdir", copy, "--unset=MAKEFLAGS", "TZ=Asia/Tokyo", "LC_ALL=C.UTF-8", "sh", "-c", make)
    (made,) = (copy / "dist").glob("fleetsight-gateway-*.tar.gz")
    return made


@pytest.fixture(scope="module")
def machine(bundle: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """The bundle where its unit expects it, in a system whose packages are unpacked, which is enough."""
    tree = tmp_path_factory.mktemp("machine") / "tree"
    checked("mmdebstrap", "--quiet", "--variant=extract", f"--include={IN_IT}", OLD_DEBIAN, tree)
    for name in ("passwd", "group"):
        shutil.copy(tree / f"usr/share/base-passwd/{name}.master", tree / "etc" / name)
    for user in ("messagebus", "fleetsight"):
        checked("chroot", tree, "useradd", "--system", "--no-create-home", "--shell", "/usr/sbin/nologin", user)
    (tree / "etc/hosts").write_text("127.0.0.1 localhost\n127.0.0.1 central\n", encoding="utf-8")
    (tree / "opt").mkdir(exist_ok=True)
    checked("tar", "-xzf", bundle, "-C", tree / "opt")
    source(tree / WORKSPACE[1:])
    settings = tree / "etc/fleetsight/gateway.yaml"
    settings.parent.mkdir()
    example = (tree / HOME[1:] / "deploy/gateway.yaml").read_text(encoding="utf-8")
    plain = example.replace("tls/central:7447", "tcp/central:7457").replace("\ntls: ", "\n# tls: ")
    settings.write_text(plain, encoding="utf-8")
    units = tree / "etc/systemd/system"
    for name in ("gateway", "space@"):
        shutil.copy(tree / HOME[1:] / f"deploy/fleetsight-{name}.service", units)
    shutil.copy(tree / HOME[1:] / "deploy/space.yaml", settings.parent)
    (units / "fleetsight-gateway.service.d").mkdir()
    (units / "fleetsight-gateway.service.d/sourced.conf").write_text(f"[Service]\nEnvironment={SOURCED}\n")
    checked("systemctl", f"--root={tree}", "--quiet", "mask", "systemd-networkd-wait-online.service")
    with booted(tree) as started:
        yield started


def source(workspace: Path) -> None:
    """Make a ROS workspace for another Python and another C library, in which whatever is loaded fails."""
    decoys(workspace, (*ALL, "numpy", "encodings", "sitecustomize", "fleetsight"))
    (workspace / "lib").mkdir()
    for name in OF_ITS_OWN:
        (workspace / "lib" / name).write_text("no library", encoding="utf-8")


def sourced(machine: Machine, *command: str, check: bool = True) -> str:
    """Return the output of a command that the service's user runs in a shell with the workspace."""
    user = ("setpriv", "--reuid=fleetsight", "--regid=fleetsight", "--clear-groups")
    return machine.run(*user, "env", *SOURCED.split(), *command, check=check)


def test_it_has_no_installer_and_the_licences_of_all_that_is_debians(bundle: Path) -> None:
    with tarfile.open(bundle) as archive:
        names = set(archive.getnames())
        listed = archive.extractfile("fleetsight/licences/packages.txt")
        assert listed is not None
        packages = [line.split()[0] for line in listed.read().decode().splitlines()]
        assert {member.uid for member in archive.getmembers()} == {0}
    assert {name.split("/")[0] for name in names} == {"fleetsight"}
    assert {"libc6", "libstdc++6", "libssl3", "python3.11-minimal"} <= set(packages)
    assert {f"fleetsight/licences/{each}" for each in (*packages, "LGPL-2.1", "GPL-3")} <= names
    assert not [name for name in names if "/dist-packages/pip" in name or "/dist-packages/setuptools" in name]


def members(archive: Path) -> Iterator[tuple[str, tuple[object, ...]]]:
    """Yield the names in an archive, with all that is said of each and its content's SHA-256."""
    with tarfile.open(archive) as opened:
        for member in opened:
            file = opened.extractfile(member) if member.isfile() else None
            content = "" if file is None else hashlib.sha256(file.read()).hexdigest()
            of = (member.type, member.mode, member.uid, member.gid, member.uname, member.mtime, member.linkname)
            yield member.name, (*of, content)


@pytest.mark.timeout(900)
def test_it_is_the_same_whoever_makes_it_where_and_when(bundle: Path, smaller: Path) -> None:
    """With more extras nothing else changes, so that one more build shows it for both."""
    more, less = dict(members(bundle)), dict(members(smaller))
    assert list(more) == sorted(more, key=lambda name: name.split("/"))
    assert {name for name in less if more.get(name) != less[name]} == set()
    assert {name.split("/")[4].partition("-")[0].partition(".")[0] for name in more.keys() - less.keys()} == OF_EXTRAS
    assert bundle.read_bytes()[:8] == smaller.read_bytes()[:8] == b"\x1f\x8b\x08" + bytes(5), "no name and no time"


@pytest.mark.timeout(900)
def test_make_bundle_lists_it_among_the_checksums(smaller: Path) -> None:
    listed = (smaller.parent / "SHA256SUMS").read_text(encoding="ascii")
    assert listed == f"{hashlib.sha256(smaller.read_bytes()).hexdigest()}  {smaller.name}\n"


def test_the_machine_has_no_python_and_a_c_library_that_is_too_old(machine: Machine) -> None:
    programs = machine.run("ls", "/bin", "/usr/bin").split()
    assert "bash" in programs
    assert [name for name in programs if name.startswith("python")] == []
    assert machine.run("getconf", "GNU_LIBC_VERSION") == "glibc 2.31\n"
    without_its_loader = machine.run("sh", "-c", f"{HOME}/lib/python --version 2>&1; echo $?")
    assert without_its_loader.endswith("\n1\n")
    assert "version `GLIBC_2.3" in without_its_loader
    assert machine.run(f"{HOME}/bin/python3", "--version").startswith("Python 3.11.")


def test_it_runs_in_a_sourced_workspace_from_any_folder_and_by_a_link(machine: Machine) -> None:
    version = f"fleetsight {_version()}\n"
    assert sourced(machine, PROGRAM, "--version") == version
    machine.run("cp", "-a", HOME, "/srv/another place")
    machine.run("ln", "-s", "/srv/another place/bin/fleetsight", "/usr/bin/fleetsight")
    assert sourced(machine, "fleetsight", "--version") == version


def test_its_python_starts_itself_and_finds_what_the_robot_says(machine: Machine) -> None:
    script = (
        "import socket, subprocess, sys; "
        "print(socket.gethostbyname('central'), sys.prefix, sys.getfilesystemencoding()); "
        "subprocess.run([sys.executable, '-c', 'import ssl, sqlite3, ctypes, numpy, zenoh; print(numpy.arange(3))'])"
    )
    assert sourced(machine, f"{HOME}/bin/python3", "-uc", script) == f"127.0.0.1 {HOME} utf-8\n[0 1 2]\n"


def test_it_runs_where_nothing_may_be_written(machine: Machine) -> None:
    at = "/mnt/read-only"
    machine.run("mkdir", "-p", at)
    machine.run("mount", "--bind", HOME, at)
    machine.run("mount", "-o", "remount,bind,ro", at)
    assert machine.run("sh", "-c", f"touch {at}/lib/new 2>&1 || true").endswith("Read-only file system\n")
    before = machine.run("ls", "-lR", "--full-time", at)
    assert f"{at}/bin:" in before
    assert "--ros-master" in machine.run(f"{at}/bin/fleetsight", "gateway", "--help")
    assert machine.run("ls", "-lR", "--full-time", at) == before


@pytest.mark.parametrize(("command", "option"), [("distance", "--robots"), ("cloud", "--robots"), ("pki", "--token")])
def test_its_extras_are_there(machine: Machine, command: str, option: str) -> None:
    assert option in sourced(machine, PROGRAM, command, "--help")


def test_what_its_extras_need_can_be_imported(machine: Machine) -> None:
    script = "import cv2, cryptography.x509, services.distance.process, services.cloud.process; print(cv2.__file__)"
    assert sourced(machine, f"{HOME}/bin/python3", "-c", script).startswith(f"{HOME}/lib/python3/dist-packages/cv2/")


def test_nothing_of_the_machines_libraries_is_loaded(machine: Machine) -> None:
    script = (
        "import pwd, ssl, numpy, zenoh; ssl.create_default_context(); pwd.getpwnam('fleetsight'); "
        "print(*{line.split()[-1] for line in open('/proc/self/maps') if '.so' in line})"
    )
    loaded = sourced(machine, f"{HOME}/bin/python3", "-c", script).split()
    assert f"{HOME}/lib/libc.so.6" in loaded
    assert [path for path in loaded if not path.startswith(f"{HOME}/")] == []


@pytest.mark.parametrize("service", ["distance", "cloud"])
def test_a_service_beside_the_gateway_starts_by_its_unit_and_ends_in_order(machine: Machine, service: str) -> None:
    unit = f"fleetsight-space@{service}"
    machine.run("systemctl", "start", unit)
    machine.until(lambda: "connected to tcp/127.0.0.1:7447" in machine.log(unit), "it finds the gateway")
    machine.run("systemctl", "stop", unit)
    assert (machine.show(unit, "Result"), machine.show(unit, "ExecMainStatus")) == ("success", "0")


def test_its_unit_forwards_a_robots_images_and_ends_in_order(machine: Machine) -> None:
    unit = "fleetsight-gateway"
    machine.until(lambda: machine.show(unit, "ActiveState") == "active", "the gateway runs")
    in_its_network = (*machine._enter[:2], "--net")
    with simulator(network=in_its_network) as robot, seeing("tcp/127.0.0.1:7457", in_its_network) as router:
        try:
            assert router.stdout is not None
            assert router.stdout.readline() == "r1 640 480\n"
            healthy = sourced(machine, PROGRAM, "doctor", "--config", "/etc/fleetsight/gateway.yaml")
            assert "camera/color" in healthy
        finally:
            robot.terminate()
            router.kill()
    machine.run("systemctl", "stop", unit)
    assert (machine.show(unit, "ActiveState"), machine.show(unit, "Result")) == ("inactive", "success")
    assert machine.show(unit, "ExecMainStatus") == "0"
    assert "decoy" not in machine.log(unit)


def _version() -> str:
    """Return the version that the checkout has."""
    lines = (ROOT / "pyproject.toml").read_text(encoding="utf-8").splitlines()
    (line,) = (line for line in lines if line.startswith("version = "))
    return line.split('"')[1]
