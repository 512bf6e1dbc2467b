"""The units of enrolment, started by systemd in a system of Debian's packages that is authority and robot at once."""

import re
import shlex
from collections.abc import Iterator

import pytest

from tests.deploy.machine import Machine, booted, make_root, make_wheels, require_containers, set_up
from tests.deploy.units import DEPLOY, unit

pytestmark = pytest.mark.timeout(300)

PROGRAM = "/opt/fleetsight/bin/fleetsight"
TLS = "/etc/fleetsight/tls"
A_MINUTE = "0.0007"
"""Days for which the certificate is good: its last third comes while the test waits."""


def told(name: str) -> list[str]:
    """Return the commands that a unit's comment tells, but for those that need a network or a running systemd."""
    commands = [line.removeprefix("#   ") for line in unit(name) if line.startswith("#   ")]
    return [line for line in commands if not line.startswith(("apt-get", "systemctl"))]


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    require_containers()
    folder = tmp_path_factory.mktemp("machine")
    wheels = make_wheels(folder / "wheels", "pki")
    tree = make_root(folder / "tree", "systemd-sysv", "dbus")
    (tree / "root/fleet.yaml").write_text("robots: [r1]\n", encoding="utf-8")
    commands = [*told("gateway"), *told("enrolment"), *told("renew")]
    script = "\n".join(f"{line[:-1]}'.[pki]'" if line.endswith(" .") else line for line in commands)
    script = script.replace(" fleet.yaml ", " /root/fleet.yaml ")
    script += f"\ninstall -d -o fleetsight -g fleetsight -m 700 {TLS}\nsystemctl enable fleetsight-enrolment\n"
    set_up(tree, wheels, script)
    settings = (DEPLOY / "enrolment.yaml").read_text(encoding="utf-8").replace("central", "127.0.0.1")
    (tree / "etc/fleetsight/enrolment.yaml").write_text(settings, encoding="utf-8")
    with booted(tree) as started:
        yield started


def test_a_machine_enrols_and_renews_by_the_units(machine: Machine) -> None:
    machine.until(lambda: "machines may enrol at" in machine.log("fleetsight-enrolment"), "the authority serves")
    invite = f"{PROGRAM} pki invite r1 --at 127.0.0.1:7448 --fleet fleet.yaml --days {A_MINUTE}"
    as_authority = f"cd /var/lib/fleetsight-pki && runuser -u fleetsight-pki -- {invite}"
    said = machine.run("/bin/sh", "-c", as_authority)
    printed = re.search(r"^fleetsight (pki enrol .*)$", said, re.MULTILINE)
    assert printed is not None
    machine.run("runuser", "-u", "fleetsight", "--", PROGRAM, *shlex.split(printed[1]), "--into", TLS)
    assert machine.run("stat", "--format=%U %a", f"{TLS}/r1.key").split() == ["fleetsight", "600"]
    assert "r1 enrolled from 127.0.0.1" in machine.log("fleetsight-enrolment")

    def renews() -> bool:
        machine.run("systemctl", "start", "fleetsight-renew")
        return "/etc/fleetsight/tls/r1.pem: renewed, until" in machine.log("fleetsight-renew")

    before = machine.run("cat", f"{TLS}/r1.pem")
    machine.until(renews, "the certificate is renewed")
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
