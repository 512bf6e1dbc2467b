"""What systemd itself says of the units."""

import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from bus.session.link_use import MAX_LINKS, most_links
from services.access.enrolment_server import MAX_CONNECTIONS
from services.toolbox.process import EXIT_USAGE
from tests.deploy.support.units import DEPLOY, unit, values
from tests.missing import require_debian

ANALYZE = "/usr/bin/systemd-analyze"
SYSTEM = Path("/usr/lib/systemd/system")

NAMES = sorted(file.stem.removeprefix("fleetsight-") for file in DEPLOY.glob("*.service"))
CONFINED = {
    "NoNewPrivileges=yes",
    "CapabilityBoundingSet=",
    "PrivateDevices=yes",
    "PrivateTmp=yes",
    "ProtectClock=yes",
    "ProtectControlGroups=yes",
    "ProtectHome=yes",
    "ProtectHostname=yes",
    "ProtectKernelLogs=yes",
    "ProtectKernelModules=yes",
    "ProtectKernelTunables=yes",
    "ProtectProc=invisible",
    "ProtectSystem=strict",
    "LockPersonality=yes",
    "RestrictAddressFamilies=AF_INET AF_INET6 AF_NETLINK AF_UNIX",
    "RestrictNamespaces=yes",
    "RestrictRealtime=yes",
    "RestrictSUIDSGID=yes",
    "SystemCallArchitectures=native",
    "SystemCallFilter=@system-service",
    "SystemCallErrorNumber=EPERM",
}
OF_DEVICES = {"PrivateDevices=yes", "ProtectClock=yes"}
"""GPUs are devices."""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A system that has the units, the program that they start, and what systemd brings with it."""
    units = tmp_path / SYSTEM.relative_to("/")
    units.mkdir(parents=True)
    for each in (*SYSTEM.glob("*.target"), *DEPLOY.glob("*.service"), *DEPLOY.glob("*.timer")):
        shutil.copy(each, units)
    program = tmp_path / "opt/fleetsight/bin/fleetsight"
    program.parent.mkdir(parents=True)
    program.touch(mode=0o755)
    return tmp_path


@pytest.mark.parametrize("name", [*(each.replace("@", "@distance") for each in NAMES), "space@cloud", "renew.timer"])
def test_systemd_has_nothing_to_say_against_the_units(root: Path, name: str) -> None:
    require_debian("systemd", [ANALYZE], how="tests/install/ros.sh installs it")
    command = [
        ANALYZE,
        "verify",
        "--man=no",
        f"--root={root}",
        f"fleetsight-{name if '.' in name else f'{name}.service'}",
    ]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (said.returncode, said.stdout, said.stderr) == (0, "", "")


@pytest.mark.parametrize("name", ["gateway", "space@", "monitor", "detector", "worldmodel"])
def test_a_unit_allows_as_many_files_as_a_router_may_have_links(name: str) -> None:
    (files,) = values(name, "LimitNOFILE")
    assert most_links(int(files)) == MAX_LINKS


def test_the_authority_may_open_more_files_than_it_takes_connections() -> None:
    (files,) = values("enrolment", "LimitNOFILE")
    assert int(files) > 2 * MAX_CONNECTIONS


@pytest.mark.parametrize("name", NAMES)
def test_a_unit_bounds_what_its_service_takes_and_is_confined(name: str) -> None:
    (most,) = values(name, "MemoryMax")
    assert most.endswith(("M", "G"))
    lines = unit(name)
    confined = [line for line in lines[lines.index("NoNewPrivileges=yes") :] if line and line != "[Install]"]
    assert {line for line in confined if not line.startswith("WantedBy=")} == (
        CONFINED - OF_DEVICES if name == "detector" else CONFINED
    )
    (user,) = values(name, "User")
    assert values(name, "Group") == [user] != ["root"]


def test_all_units_but_the_timer_s_run_on() -> None:
    assert {name for name in NAMES if values(name, "Type") != ["notify"]} == {"renew"}
    assert values("renew", "Type") == ["oneshot"]
    assert values("renew", "TimeoutStartSec"), "a hung one has no watchdog"


@pytest.mark.parametrize("name", [name for name in NAMES if name != "renew"])
def test_a_unit_that_runs_on_is_watched_and_started_again_for_ever(name: str) -> None:
    assert values(name, "WatchdogSec") == ["30"]
    assert values(name, "LimitNOFILE")
    assert (values(name, "Restart"), values(name, "RestartSec")) == (["always"], ["3"])
    assert values(name, "StartLimitIntervalSec") == ["0"]
    assert values(name, "TimeoutStopSec") == ["5"]
    assert values(name, "RestartPreventExitStatus") == []
    assert values(name, "WantedBy") == ["multi-user.target"]


@pytest.mark.parametrize("name", NAMES)
def test_settings_and_keys_are_installed_for_the_service_and_nobody_else_to_read(name: str) -> None:
    """Certificates may be read by everybody; a process refuses a key that others may read."""
    for line in unit(name):
        if "install " in line and line.startswith("#") and "/etc/fleetsight/" in line and ".pem " not in line:
            mode = " -o fleetsight -g fleetsight -m 400 " if ".key " in line else " -g fleetsight -m 640 "
            assert mode in line


def test_a_setting_that_systemd_does_not_know_is_told(root: Path) -> None:
    require_debian("systemd", [ANALYZE], how="tests/install/ros.sh installs it")
    file = root / SYSTEM.relative_to("/") / "fleetsight-gateway.service"
    file.write_text(file.read_text(encoding="utf-8").replace("ProtectClock=", "ProtectClocks="), encoding="utf-8")
    command = [ANALYZE, "verify", "--man=no", f"--root={root}", file.name]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "ProtectClocks" in said.stderr


def test_what_time_may_mend_ends_a_process_as_a_wrong_setting_does() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        listen = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        command = [sys.executable, "-m", "services.toolbox", "gateway", "--robot", "r1", "--mode", "router"]
        ended = subprocess.run([*command, "--listen", listen], capture_output=True, text=True, check=False)
    assert ended.returncode == EXIT_USAGE
    assert ended.stderr.endswith("Address already in use\n")
