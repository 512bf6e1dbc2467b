"""What systemd itself says of the units."""

import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from bus.session.link_use import MAX_LINKS, most_links
from services.toolbox.process import EXIT_USAGE
from tests.deploy.units import DEPLOY, values
from tests.missing import require_debian

ANALYZE = "/usr/bin/systemd-analyze"
SYSTEM = Path("/usr/lib/systemd/system")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A system that has the units, the program that they start, and what systemd brings with it."""
    units = tmp_path / SYSTEM.relative_to("/")
    units.mkdir(parents=True)
    for unit in (*SYSTEM.glob("*.target"), *DEPLOY.glob("*.service"), *DEPLOY.glob("*.timer")):
        shutil.copy(unit, units)
    program = tmp_path / "opt/fleetsight/bin/fleetsight"
    program.parent.mkdir(parents=True)
    program.touch(mode=0o755)
    return tmp_path


UNITS = [
    *("gateway", "space@distance", "space@cloud", "monitor", "detector", "worldmodel", "enrolment", "renew"),
    "renew.timer",
]


@pytest.mark.parametrize("unit", UNITS)
def test_systemd_has_nothing_to_say_against_the_units(root: Path, unit: str) -> None:
    require_debian("systemd", [ANALYZE], how="tests/install/ros.sh installs it")
    command = [
        ANALYZE,
        "verify",
        "--man=no",
        f"--root={root}",
        f"fleetsight-{unit if '.' in unit else f'{unit}.service'}",
    ]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (said.returncode, said.stdout, said.stderr) == (0, "", "")


@pytest.mark.parametrize("name", ["gateway", "space@", "monitor", "detector", "worldmodel"])
def test_a_unit_allows_as_many_files_as_a_router_may_have_links(name: str) -> None:
    (files,) = values(name, "LimitNOFILE")
    assert most_links(int(files)) == MAX_LINKS


@pytest.mark.parametrize("name", ["gateway", "space@", "monitor", "detector", "worldmodel", "enrolment", "renew"])
def test_a_unit_bounds_the_memory_of_its_service(name: str) -> None:
    (most,) = values(name, "MemoryMax")
    assert most.endswith(("M", "G", "%"))


@pytest.mark.parametrize("unit", sorted(DEPLOY.glob("*.service")), ids=lambda unit: unit.stem)
def test_settings_are_installed_for_the_service_and_nobody_else_to_read(unit: Path) -> None:
    lines = unit.read_text(encoding="utf-8").splitlines()
    installs = [line for line in lines if "install " in line and line.startswith("#") and "/etc/fleetsight/" in line]
    assert all(" -g fleetsight -m 640 " in line for line in installs)


def test_a_setting_that_systemd_does_not_know_is_told(root: Path) -> None:
    require_debian("systemd", [ANALYZE], how="tests/install/ros.sh installs it")
    unit = root / SYSTEM.relative_to("/") / "fleetsight-gateway.service"
    unit.write_text(unit.read_text(encoding="utf-8").replace("ProtectClock=", "ProtectClocks="), encoding="utf-8")
    command = [ANALYZE, "verify", "--man=no", f"--root={root}", unit.name]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "ProtectClocks" in said.stderr


def test_what_time_may_mend_ends_a_process_as_a_wrong_setting_does() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        listen = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        command = [sys.executable, "-m", "services.toolbox", "gateway", "--robot", "r1", "--mode", "router"]
        ended = subprocess.run([*command, "--listen", listen], capture_output=True, text=True, check=False)
    assert ended.returncode == EXIT_USAGE
    assert ended.stderr.endswith("Address already in use\n")


@pytest.mark.parametrize("name", ["gateway", "space@", "monitor", "detector"])
def test_a_unit_goes_on_after_it(name: str) -> None:
    assert (values(name, "Restart"), values(name, "RestartPreventExitStatus")) == (["always"], [])
