"""The units, started by systemd in a system made of Debian's packages, installed as their comments say.

The one machine is a robot, the centre and the authority where machines enrol, since making and booting it takes long.
"""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.deploy.support import units
from tests.deploy.support.machine import Machine, booted, make_root, require_containers, root_archive, set_up, wheels

SERVICES = ("gateway", "monitor", "worldmodel", "space@distance", "space@cloud", "detector")
SETTINGS = ("gateway", "monitor", "worldmodel", "space", "detector")
pytestmark = pytest.mark.timeout(1200)  # a system is made first

EXTRAS = "monitor,distance,cloud,worldmodel,detector-onnx,pki"
PROGRAM = "/opt/fleetsight/bin/fleetsight"
TLS = "/etc/fleetsight/tls"
A_MINUTE = "0.0007"
"""Days for which the certificate is good: its last third comes while the test waits."""

WATCHED = (*(each for each in SERVICES if each != "space@cloud"), "enrolment")
WATCHDOG_S = 10
FED = "WatchdogTimestampMonotonic"
CENTRAL = "tls/127.0.0.1:7457"
"""Where the monitor of this one machine listens: a robot's gateway has 7447."""

FLEET = "robots: [r1]\nroles: {central: [monitor, worldmodel], gpu1: detector}\n"
ISSUE = f"""
mkdir /root/pki && cd /root/pki
{PROGRAM} pki init --folder .
for name in central gpu1 r1; do {PROGRAM} pki issue $name --folder .; done
{PROGRAM} access /root/fleet.yaml --folder . --to access.json
"""
"""Makes the links' certificates as docs/security.md says. Enrolment has an authority of its own."""

ASK = "import sys, urllib.request as web; print(web.urlopen(sys.argv[1], timeout=5).read().decode())"


def told(name: str) -> list[str]:
    """Return the commands that a unit's comment tells, but for those that need a network or a running systemd."""
    commands = [line.removeprefix("#   ") for line in units.unit(name) if line.startswith("#   ")]
    return [line for line in commands if not line.startswith(("apt-get", "systemctl"))]


def script() -> str:
    """Return what sets the machine up, with the extras of all that is started there."""
    of_links = re.compile(r" (ca\.pem|access\.json|\w+\.key) ")
    commands = [each for name in ("gateway", "enrolment", "renew") for each in told(name) if not of_links.search(each)]
    copied = [each for name in ("gateway", "monitor", "detector") for each in told(name) if of_links.search(each)]
    assert any(line.endswith(" '.[pki]'") for line in commands)
    assert len(copied) == 7  # of the gateway and the detector two each, of the monitor three
    files = [f"deploy/fleetsight-{name}.service" for name in ("gateway", "monitor", "worldmodel", "space@", "detector")]
    enabled = " ".join(shlex.quote(f"fleetsight-{name}") for name in (*SERVICES, "enrolment"))
    lines = [line.replace("'.[pki]'", f"'.[{EXTRAS}]'") for line in commands]
    return "\n".join(
        (
            *(line.replace(" fleet.yaml ", " /root/fleet.yaml ") for line in lines),
            f"install -d -o fleetsight -g fleetsight -m 700 {TLS}",
            f"install -m 644 {' '.join(files)} /etc/systemd/system/",
            f"systemctl enable {enabled}",
            ISSUE,
            *copied,
        )
    )


def settings(name: str) -> str:
    """Return the settings of an example for a machine that has everything."""
    text = (units.DEPLOY / f"{name}.yaml").read_text(encoding="utf-8")
    if name == "space":
        return text
    first, *others = text.splitlines(keepends=True)
    return first + "".join(re.sub(r"tls/[\w.]+:7447", CENTRAL, line) for line in others)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    require_containers()
    archive = root_archive(tmp_path_factory)
    tree = make_root(tmp_path_factory.mktemp("machine") / "tree", archive, "systemd-sysv", "dbus", "python3-venv")
    (tree / "root/fleet.yaml").write_text(FLEET, encoding="utf-8")
    set_up(tree, wheels(tmp_path_factory), script())
    for name in SETTINGS:
        (tree / f"etc/fleetsight/{name}.yaml").write_text(settings(name), encoding="utf-8")
    enrolment = (units.DEPLOY / "enrolment.yaml").read_text(encoding="utf-8").replace("central", "127.0.0.1")
    (tree / "etc/fleetsight/enrolment.yaml").write_text(enrolment, encoding="utf-8")
    shorter = tree / "etc/systemd/system/fleetsight-.service.d"  # of every unit whose name begins so
    shorter.mkdir()
    (shorter / "watchdog.conf").write_text(f"[Service]\nWatchdogSec={WATCHDOG_S}\n", encoding="utf-8")
    with booted(tree) as started:
        yield started


def open_files(machine: Machine, limits: Path) -> tuple[str, str]:
    """Return how many files a process may have open, and how many it may ask for."""
    found = re.search(r"^Max open files +(\d+) +(\d+)", machine.run("cat", str(limits)), re.MULTILINE)
    assert found
    return found[1], found[2]


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_runs_confined_under_its_own_user(machine: Machine, name: str) -> None:
    unit = f"fleetsight-{name}"
    machine.until(lambda: machine.show(unit, "ActiveState") == "active", f"{unit} runs")
    assert machine.show(unit, "Type") == "notify"
    status = Path(f"/proc/{machine.show(unit, 'MainPID')}/status")
    fields = dict(line.split(":\t", 1) for line in machine.run("cat", str(status)).splitlines() if ":\t" in line)
    assert fields["Uid"].split()[0] == machine.run("id", "--user", "fleetsight").strip() != "0"
    assert (fields["NoNewPrivs"], int(fields["CapEff"], 16)) == ("1", 0)
    asked = int(machine.show(unit, "LimitNOFILE"))
    assert f"LimitNOFILE={asked}\n" in machine.run("systemctl", "cat", unit)
    most = int(open_files(machine, Path("/proc/1/limits"))[1])  # a machine may let nobody have more
    assert open_files(machine, status.with_name("limits")) == (str(min(asked, most)),) * 2


def test_no_unit_failed(machine: Machine) -> None:
    machine.until(
        lambda: machine.run("systemctl", "is-system-running", check=False).strip() == "running", "the system is up"
    )
    assert machine.run("systemctl", "--failed", "--plain", "--no-legend") == ""


def test_they_reach_each_other_and_the_monitor_is_healthy(machine: Machine) -> None:
    machine.until(lambda: "connected to" in machine.log("fleetsight-space@distance"), "distance is connected")
    machine.until(lambda: "connected to" in machine.log("fleetsight-gateway"), "the gateway is connected")
    ask = ("/opt/fleetsight/bin/python3", "-c", ASK, "http://127.0.0.1:8080/healthz")
    machine.until(lambda: '{"status":"ok"' in machine.run(*ask, check=False), "the monitor is healthy")
    assert machine.run("stat", "--format=%U %a", "/var/lib/fleetsight/history.db").split()[0] == "fleetsight"


@pytest.fixture(scope="module")
def fed(machine: Machine) -> dict[str, str]:
    """When each unit's watchdog was fed, all at the same time."""
    return {name: machine.show(f"fleetsight-{name}", FED) for name in WATCHED}


@pytest.mark.parametrize("name", WATCHED)
def test_a_process_feeds_its_watchdog(machine: Machine, fed: dict[str, str], name: str) -> None:
    unit = f"fleetsight-{name}"
    assert machine.show(unit, "WatchdogUSec") == f"{WATCHDOG_S}s"
    machine.until(lambda: int(machine.show(unit, FED)) > int(fed[name]), f"{unit} feeds its watchdog")
    assert machine.show(unit, "NRestarts") == "0"


@pytest.fixture(scope="module")
def hung(machine: Machine) -> dict[str, str]:
    """Stop all processes at the same time; return which they were."""
    before = {name: machine.show(f"fleetsight-{name}", "MainPID") for name in WATCHED}
    machine.run("systemctl", "kill", "--signal=STOP", *(f"fleetsight-{name}" for name in WATCHED))
    return before


@pytest.mark.parametrize("name", WATCHED)
def test_a_process_that_hangs_is_started_again(machine: Machine, hung: dict[str, str], name: str) -> None:
    unit = f"fleetsight-{name}"
    machine.until(lambda: machine.show(unit, "NRestarts") != "0", "the watchdog notices")
    machine.until(lambda: machine.show(unit, "ActiveState") == "active", "it runs again")
    assert machine.show(unit, "MainPID") not in ("0", hung[name])
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


def test_a_machine_enrols_and_renews_by_the_units(machine: Machine) -> None:
    machine.until(lambda: "machines may enrol at" in machine.log("fleetsight-enrolment"), "the authority serves")
    invite = f"{PROGRAM} pki invite r1 --at 127.0.0.1:7448 --fleet fleet.yaml --days {A_MINUTE}"
    as_authority = f"cd /var/lib/fleetsight-pki && runuser -u fleetsight-pki -- {invite}"
    said = machine.run("/bin/sh", "-c", as_authority)
    printed = re.search(r"^fleetsight (pki enrol .*)$", said, re.MULTILINE)
    assert printed is not None
    token = next(line for line in said.splitlines() if line.startswith("r1:"))
    enrol = ("env", f"FLEETSIGHT_TOKEN={token}", PROGRAM, *shlex.split(printed[1]), "--into", TLS)
    machine.run("runuser", "-u", "fleetsight", "--", *enrol)
    assert machine.run("stat", "--format=%U %a", f"{TLS}/r1.key").split() == ["fleetsight", "600"]
    assert "r1 enrolled from 127.0.0.1" in machine.log("fleetsight-enrolment")

    def renews() -> bool:
        machine.run("systemctl", "start", "fleetsight-renew")
        return "/etc/fleetsight/tls/r1.pem: renewed, until" in machine.log("fleetsight-renew")

    before = machine.run("cat", f"{TLS}/r1.pem")
    machine.until(renews, "the certificate is renewed", every_s=3)  # of the 20 s of its last third
    assert machine.run("cat", f"{TLS}/r1.pem") != before
    assert machine.run("stat", "--format=%U %a", f"{TLS}/r1.key").split() == ["fleetsight", "600"]


def test_the_timer_is_waited_for(machine: Machine) -> None:
    machine.run("systemctl", "enable", "--now", "fleetsight-renew.timer")
    assert machine.show("fleetsight-renew.timer", "ActiveState") == "active"
    assert machine.show("fleetsight-renew.timer", "NextElapseUSecRealtime")


def test_the_authority_is_stopped_in_order(machine: Machine) -> None:
    name = "fleetsight-enrolment"
    status = f"/proc/{machine.show(name, 'MainPID')}/status"
    fields = dict(line.split(":\t", 1) for line in machine.run("cat", status).splitlines() if ":\t" in line)
    assert fields["Uid"].split()[0] == machine.run("id", "--user", "fleetsight-pki").strip() != "0"
    machine.run("systemctl", "stop", name)
    assert (machine.show(name, "ActiveState"), machine.show(name, "Result")) == ("inactive", "success")
    assert machine.show(name, "ExecMainStatus") == "0"
