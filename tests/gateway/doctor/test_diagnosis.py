from gateway.doctor.evidence import BusLook, Failure, HostLook, MasterLook, Router, Trouble
from gateway.doctor.finding import Severity, Stage
from gateway.doctor.report import diagnose, healthy
from tests.gateway.doctor.seeing import TF, color, color_info, depth, depth_info, evidence, links, sends


def test_a_healthy_robot() -> None:
    static = sends("tf_static", "/tf_static", TF, links(("base_link", "lens")))
    findings = diagnose(evidence(color(), depth(), color_info(), depth_info(), beside=(static,)))
    assert {each.severity for each in findings} == {Severity.OK}
    assert healthy(findings)


def test_findings_follow_the_way_of_the_data() -> None:
    findings = diagnose(evidence(color(), depth(), color_info(), depth_info()))
    assert list(dict.fromkeys(each.stage for each in findings)) == list(Stage)


def test_a_note_is_no_problem() -> None:
    findings = diagnose(evidence(color(), depth(), color_info(), depth_info(f=7.0)))
    assert Severity.NOTE in {each.severity for each in findings}
    assert healthy(findings)


def test_everything_dead_at_once() -> None:
    dead = Trouble(Failure.DEAD, "robot", 1)
    seen = evidence(
        color(),
        master=MasterLook("http://robot:11311", dead),
        host=HostLook("nowhere"),
        bus=BusLook((Router("tcp/robot:1", dead),)),
    )
    findings = diagnose(seen)
    assert [each.stage for each in findings] == [Stage.MASTER, Stage.HOST, Stage.GATEWAY]
    assert {each.severity for each in findings} == {Severity.PROBLEM}
    assert not healthy(findings)
