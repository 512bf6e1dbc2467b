from dataclasses import replace

import pytest

from gateway.doctor.evidence import Failure, Graph, HostLook, MasterLook, Trouble
from gateway.doctor.finding import Finding, Severity, Stage
from gateway.doctor.master import check_host, check_master

URI = "http://robot:11311"


def master(failure: Failure, reason: str = "") -> Finding:
    (finding,) = check_master(MasterLook(URI, Trouble(failure, "robot", 11311, reason)))
    assert (finding.severity, finding.stage, finding.subject) == (Severity.PROBLEM, Stage.MASTER, URI)
    return finding


@pytest.mark.parametrize(
    ("failure", "what", "advice"),
    [
        (Failure.UNRESOLVED, "the host name robot does not resolve", "/etc/hosts"),
        (Failure.DEAD, "nothing listens at robot:11311", "start roscore"),
        (Failure.REFUSED, "something answers at robot:11311, but not as a ROS master does: why", "port"),
        (Failure.FOREIGN, "something answers at robot:11311, but not as a ROS master does: why", "port"),
        (Failure.SILENT, "no answer from robot:11311 (why)", "roscore hangs"),
        (Failure.OFF, "no answer from robot:11311 (why)", "firewall"),
    ],
)
def test_a_master_that_does_not_answer(failure: Failure, what: str, advice: str) -> None:
    finding = master(failure, "why")
    assert what in finding.what
    assert advice in finding.advice


def test_a_master_that_answers() -> None:
    graph = Graph(publishers={"/rosout": ("/a",), "/front": ("/a",), "/ultralytics/detection/classes": ("/g",)})
    (finding,) = check_master(MasterLook(URI, graph=graph))
    assert (finding.severity, finding.what) == (Severity.OK, "answers; 1 topics have publishers")


def test_a_master_at_which_only_the_log_and_our_results_are_published() -> None:
    graph = Graph(publishers={"/rosout": ("/a",), "/ultralytics/detection/classes": ("/g",)})
    (finding,) = check_master(MasterLook(URI, graph=graph))
    assert finding.severity is Severity.NOTE
    assert "ROS_MASTER_URI" in finding.advice


REACHABLE = HostLook("robot", ("192.168.0.7",), ours=True)


@pytest.mark.parametrize(
    ("look", "remote", "severity", "what"),
    [
        (REACHABLE, True, Severity.OK, "something can listen here"),
        (replace(REACHABLE, addresses=(), ours=False), False, Severity.PROBLEM, "does not resolve"),
        (replace(REACHABLE, addresses=("0.0.0.0",)), False, Severity.PROBLEM, "not an address that others"),  # noqa: S104
        (replace(REACHABLE, ours=False), False, Severity.PROBLEM, "not an address of this machine (192.168.0.7)"),
        (HostLook("127.0.0.1", ("127.0.0.1",), ours=True), False, Severity.OK, "something can listen here"),
        (HostLook("127.0.0.1", ("127.0.0.1",), ours=True), True, Severity.PROBLEM, "cannot connect back"),
        (HostLook("::1", ("::1",), ours=True), True, Severity.PROBLEM, "cannot connect back"),
        (HostLook("localhost", ("127.0.0.1",), ours=True), True, Severity.PROBLEM, "cannot connect back"),
        (HostLook("robot", ("127.0.1.1",), ours=True), True, Severity.NOTE, "resolves to the loopback here"),
        (HostLook("robot", ("127.0.1.1", "192.168.0.7"), ours=True), True, Severity.OK, "can listen here"),
    ],
)
def test_what_others_are_told_to_connect_to(look: HostLook, *, remote: bool, severity: Severity, what: str) -> None:
    (finding,) = check_host(look, remote_master=remote)
    assert (finding.severity, finding.subject) == (severity, look.host)
    assert what in finding.what
    assert bool(finding.advice) == (severity is not Severity.OK)
