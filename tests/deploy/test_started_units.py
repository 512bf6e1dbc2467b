"""The units, started by systemd in a system made of Debian's packages, installed as their comments say."""

import json
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.deploy.machine import Machine, booted, make_root, make_wheels, require_containers, set_up
from tests.deploy.units import DEPLOY

SERVICES = ("gateway", "monitor", "worldmodel", "space@distance", "space@cloud")
SETTINGS = ("gateway", "monitor", "worldmodel", "space")
pytestmark = pytest.mark.timeout(300)

WATCHDOG_S = 3
CENTRAL = "tcp/127.0.0.1:7457"
"""Where the monitor of this one machine listens: a robot's gateway has 7447."""

ASK = "import sys, urllib.request as web; print(web.urlopen(sys.argv[1], timeout=5).read().decode())"


def told() -> str:
    """Return the commands that the gateway's unit tells, with the extras of all that is started here."""
    lines = (DEPLOY / "fleetsight-gateway.service").read_text(encoding="utf-8").splitlines()
    commands = [line.removeprefix("#   ") for line in lines if line.startswith("#   ")]
    offline = [line for line in commands if not line.startswith(("apt-get", "systemctl"))]
    assert any(line.endswith(" .") for line in offline)
    return "\n".join(
        f"{line[:-1]}'.[monitor,distance,cloud,worldmodel]'" if line.endswith(" .") else line for line in offline
    )


def settings(name: str) -> str:
    """Return the settings of an example for a machine that has everything."""
    text = (DEPLOY / f"{name}.yaml").read_text(encoding="utf-8")
    if name == "space":
        return text
    first, *others = text.splitlines(keepends=True)
    return first + "".join(
        line.replace("tcp/0.0.0.0:7447", CENTRAL).replace("tcp/central:7447", CENTRAL)
        if name != "worldmodel"
        else line.replace("tcp/127.0.0.1:7447", CENTRAL)
        for line in others
    )


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    require_containers()
    folder = tmp_path_factory.mktemp("machine")
    wheels = make_wheels(folder / "wheels", "monitor,distance,cloud,worldmodel")
    tree = make_root(folder / "tree", "systemd-sysv", "dbus")
    units = [f"deploy/fleetsight-{name}.service" for name in ("gateway", "monitor", "worldmodel", "space@")]
    enabled = " ".join(shlex.quote(f"fleetsight-{name}") for name in SERVICES)
    set_up(
        tree,
        wheels,
        f"{told()}\ninstall -m 644 {' '.join(units)} /etc/systemd/system/\nsystemctl enable {enabled}",
    )
    for name in SETTINGS:
        (tree / f"etc/fleetsight/{name}.yaml").write_text(settings(name), encoding="utf-8")
    shorter = tree / "etc/systemd/system/fleetsight-gateway.service.d"
    shorter.mkdir()
    (shorter / "watchdog.conf").write_text(f"[Service]\nWatchdogSec={WATCHDOG_S}\n", encoding="utf-8")
    with booted(tree) as started:
        yield started


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_runs_confined_under_its_own_user(machine: Machine, name: str) -> None:
    unit = f"fleetsight-{name}"
    machine.until(lambda: machine.show(unit, "ActiveState") == "active", f"{unit} runs")
    assert machine.show(unit, "Type") == "notify"
    status = Path(f"/proc/{machine.show(unit, 'MainPID')}/status")
    fields = dict(line.split(":\t", 1) for line in machine.run("cat", str(status)).splitlines() if ":\t" in line)
    assert fields["Uid"].split()[0] == machine.run("id", "--user", "fleetsight").strip() != "0"
    assert (fields["NoNewPrivs"], int(fields["CapEff"], 16)) == ("1", 0)


def test_no_unit_failed(machine: Machine) -> None:
    machine.until(
        lambda: machine.run("systemctl", "is-system-running", check=False).strip() == "running", "the system is up"
    )
    assert machine.run("systemctl", "--failed", "--plain", "--no-legend") == ""


def test_they_reach_each_other_and_the_monitor_is_healthy(machine: Machine) -> None:
    machine.until(lambda: "connected to" in machine.log("fleetsight-space@distance"), "distance is connected")
    machine.until(lambda: "connected to" in machine.log("fleetsight-gateway"), "the gateway is connected")
    healthy = machine.run("/opt/fleetsight/bin/python3", "-c", ASK, "http://127.0.0.1:8080/healthz")
    assert json.loads(healthy)["status"] == "ok"
    assert machine.run("stat", "--format=%U %a", "/var/lib/fleetsight/history.db").split()[0] == "fleetsight"


def test_a_process_that_hangs_is_started_again(machine: Machine) -> None:
    unit = "fleetsight-gateway"
    before = machine.show(unit, "MainPID")
    machine.run("systemctl", "kill", "--signal=STOP", unit)
    machine.until(lambda: machine.show(unit, "NRestarts") == "1", "the watchdog notices")
    machine.until(lambda: machine.show(unit, "ActiveState") == "active", "it runs again")
    assert machine.show(unit, "MainPID") not in ("0", before)
    assert "watchdog" in machine.log(unit).lower()


def test_a_process_that_is_killed_is_started_again(machine: Machine) -> None:
    unit = "fleetsight-space@cloud"
    machine.run("systemctl", "kill", "--signal=KILL", unit)
    machine.until(lambda: machine.show(unit, "NRestarts") == "1", "it is noticed")
    machine.until(lambda: machine.show(unit, "ActiveState") == "active", "it runs again")


@pytest.mark.parametrize("name", ["space@distance", "monitor"])
def test_it_is_stopped_in_order(machine: Machine, name: str) -> None:
    unit = f"fleetsight-{name}"
    machine.run("systemctl", "stop", unit)
    assert (machine.show(unit, "ActiveState"), machine.show(unit, "Result")) == ("inactive", "success")
    assert machine.show(unit, "ExecMainStatus") == "0"
