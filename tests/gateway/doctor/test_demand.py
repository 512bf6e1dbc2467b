from dataclasses import replace
from typing import Any

import pytest

from gateway.doctor.demand import check_demand, check_recorders
from gateway.doctor.evidence import BusLook, Graph, MasterLook, Router, StreamLook
from gateway.doctor.finding import Finding, Severity, Stage
from gateway.ros1.tcpros.subscriber import LinkFailure
from gateway.to_bus.stream import MALFORMED, MISMATCH
from gateway.to_bus.translators import kind_of
from schemas.status import REPLACED_BEFORE_LINK, StreamStatus
from tests.gateway.doctor.seeing import IMAGE, account, color, counted, evidence, heard, publisher, status, stream

POINTS = "sensor_msgs/PointCloud2"
WANTED: dict[str, Any] = {"wanted": True, "publishers": 1}
SILENT = stream("front/color", "/front/color/image_raw", IMAGE)


def said(before: StreamStatus, after: StreamStatus, look: StreamLook | None = None) -> list[Finding]:
    """Return what is said after the gateway gave these two accounts, two seconds apart."""
    one = account(status(before), status(after, sent_s=2.0))
    found = list(check_demand(evidence(look or color(), bus=BusLook((Router("tcp/a:1"),), frozenset({"r1"}), (one,)))))
    assert {(each.stage, each.subject) for each in found} == {(Stage.DEMAND, "front/color")}
    return found


def test_nobody_wants_it_and_that_is_fine() -> None:
    (finding,) = said(counted(), counted())
    assert finding.severity is Severity.OK
    assert finding.what.startswith("nobody subscribes, so it is not forwarded")


def test_wanted_and_flowing() -> None:
    (finding,) = said(counted(**WANTED), counted(**WANTED, received=21, forwarded=20))
    assert (finding.severity, finding.what) == (Severity.OK, "wanted, and flowing at 10.0 messages/s")


def test_one_account_knows_no_rate() -> None:
    once = status(counted(**WANTED, received=9, forwarded=9))
    bus = BusLook((Router("tcp/a:1"),), frozenset({"r1"}), (account(once, once, count=1),))
    (finding,) = check_demand(evidence(SILENT, bus=bus))
    assert (finding.severity, finding.what) == (Severity.OK, "wanted; 9 messages so far, none just now")


def test_one_account_of_a_stream_that_is_published_is_no_problem() -> None:
    once = status(counted(**WANTED, received=1, forwarded=1))
    bus = BusLook((Router("tcp/a:1"),), frozenset({"r1"}), (account(once, once, count=1),))
    (finding,) = check_demand(evidence(color(), bus=bus))
    assert (finding.severity, finding.what) == (Severity.OK, "wanted; 1 messages so far, none just now")


def test_wanted_but_nothing_gets_through() -> None:
    after = counted(**WANTED, received=20, dropped={MALFORMED: 20})
    problem, note = said(counted(**WANTED), after)
    assert problem.severity is Severity.PROBLEM
    assert problem.what == "wanted, but none of the 20 messages that came in 2.0 s got through"
    assert (note.severity, note.what) == (
        Severity.NOTE,
        "20 of 20 messages since the gateway started: malformed",
    )


def test_wanted_without_a_publisher() -> None:
    wanted = counted(wanted=True, broken_links={str(LinkFailure.UNREACHABLE): 3})
    (finding,) = said(wanted, wanted, SILENT)
    assert finding.severity is Severity.PROBLEM
    assert finding.what == "wanted, but the gateway has no connection to a publisher (unreachable 3 times)"
    assert "cannot be reached from the gateway" in finding.advice


def test_wanted_without_a_publisher_that_was_ever_tried() -> None:
    (finding,) = said(counted(wanted=True), counted(wanted=True), SILENT)
    assert finding.what.endswith("no connection to a publisher")


def test_published_but_not_at_the_gateway() -> None:
    (finding,) = said(counted(**WANTED), counted(**WANTED))
    assert finding.severity is Severity.PROBLEM
    assert "is the gateway at the same ROS master?" in finding.advice


def test_wanted_and_silent() -> None:
    (finding,) = said(counted(**WANTED), counted(**WANTED), SILENT)
    assert finding.severity is Severity.NOTE


@pytest.mark.parametrize(
    ("reason", "advice"),
    [
        (MALFORMED, "correct the driver"),
        (MISMATCH, "ros/NAME"),
        (REPLACED_BEFORE_LINK, "the link is slower"),
        ("over the uplink budget", "raise it"),
        ("thinned to max_hz", "raise it if more is needed"),
        ("replaced by a newer frame before it was compressed", "slower than the camera sends"),
        ("cannot be scaled or compressed as set", "change it"),
        ("not sent yet when its stream or its publisher ended", "left"),
        ("something new", ""),
    ],
)
def test_every_drop_has_its_advice(reason: str, advice: str) -> None:
    _, note = said(counted(), counted(received=10, dropped={reason: 4, "other": 0}))
    assert note.what == f"4 of 10 messages since the gateway started: {reason}"
    assert advice in note.advice


def test_a_stream_that_the_running_gateway_does_not_offer() -> None:
    (finding,) = said(counted("rear/color", "/rear"), counted("rear/color", "/rear"))
    assert (finding.severity, finding.what) == (Severity.PROBLEM, "the running gateway does not offer this stream")


def test_colours_of_clouds_that_are_no_pictures_are_withdrawn_for_another_reason_than_options() -> None:
    unreadable = replace(heard(), unreadable="a cloud of 1 x 6 points is not an image")
    named = stream("front/color", "/front/points", POINTS, publisher(POINTS, unreadable))
    found = replace(named, special=kind_of(named.key, of_points=True))
    for look, count in ((named, 1), (found, 0)):
        nothing = BusLook((Router("tcp/a:1"),), frozenset({"r1"}), (account(status(), status(sent_s=2.0)),))
        assert len(list(check_demand(evidence(look, bus=nothing)))) == count


def test_a_stream_that_the_running_gateway_takes_from_elsewhere() -> None:
    (finding,) = said(counted(topic="/other"), counted(topic="/other"))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == "the running gateway takes it from /other, not from /front/color/image_raw"


def test_a_stream_that_is_new_since_the_first_account() -> None:
    now = status(counted(**WANTED, forwarded=4, received=4), sent_s=2)
    (finding,) = check_demand(evidence(color(), bus=BusLook((), frozenset(), (account(status(), now),))))
    assert (finding.severity, finding.what) == (Severity.OK, "wanted, and flowing at 2.0 messages/s")


def test_without_a_gateway_nothing_is_known() -> None:
    assert not list(check_demand(evidence(color(), bus=BusLook())))


def test_streams_of_the_whole_robot_are_found_by_their_name() -> None:
    mode = counted("text/mode", "/mode", camera="", stream="text/mode")
    both = account(status(mode), status(mode))
    look = stream("text/mode", "/mode", "std_msgs/String")
    (finding,) = check_demand(evidence(look, bus=BusLook((), frozenset(), (both,))))
    assert finding.severity is Severity.OK


GATEWAY = "/fleetsight_gateway_r1_01234567"
RESULTS = ("/ultralytics/detection/classes", "/ultralytics/detection/image", "/ultralytics/alerts")


def recorded(*subscribed: str, recorder: str = "/record_1764000000", passive: str = "") -> list[Finding]:
    graph = Graph(
        publishers=dict.fromkeys((*RESULTS, "/planner/stop"), (GATEWAY,)),
        subscribers={topic: ("/planner", recorder) if topic == RESULTS[0] else (recorder,) for topic in subscribed},
    )
    seen = evidence(color(), master=MasterLook("http://robot:11311", graph=graph), passive=passive)
    return list(check_recorders(seen))


def test_who_records_all_results() -> None:
    (finding,) = recorded(*RESULTS)
    assert (finding.severity, finding.stage, finding.subject) == (Severity.NOTE, Stage.DEMAND, "/record_1764000000")
    assert finding.what.startswith(f"subscribes to all 3 results of {GATEWAY}, as `rosbag record -a` does")
    assert "`rosbag record -a -x '.*/(ultralytics|fleetsight)/.*'`" in finding.advice
    assert "--passive-subscribers '/record_.*'" in finding.advice


def test_recorders_that_make_nothing_wanted_or_record_some_results_need_no_word() -> None:
    assert recorded(*RESULTS, passive="/record_.*") == recorded(*RESULTS[:2]) == recorded() == []
    (finding,) = recorded(*RESULTS, recorder="/bag", passive="/record_.*")
    assert "--passive-subscribers '/bag'" in finding.advice
