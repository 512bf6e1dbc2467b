from typing import Any

import pytest

from gateway.doctor.evidence import BusLook, Failure, GatewayReport, Router, Trouble
from gateway.doctor.finding import Finding, Severity, Stage
from gateway.doctor.presence import check_fleet, check_presence
from tests.gateway.doctor.seeing import account, counted, evidence, status

CENTRAL = "tcp/central:7447"


def router(failure: Failure | None = None, endpoint: str = CENTRAL) -> Router:
    return Router(endpoint, Trouble(failure, "central", 7447) if failure else None)


def one(**changes: Any) -> GatewayReport:
    return account(status(), status(sent_s=2.0), **changes)


def said(
    *accounts: GatewayReport, robots: frozenset[str] = frozenset({"r1"}), routers: tuple[Router, ...] = (router(),)
) -> list[Finding]:
    found = list(check_presence(evidence(bus=BusLook(routers, robots, accounts))))
    assert {each.stage for each in found} <= {Stage.GATEWAY}
    return found


def test_a_gateway_that_is_there() -> None:
    (finding,) = said(one())
    assert (finding.severity, finding.what) == (Severity.OK, "its gateway is on the bus and waits for nothing")


@pytest.mark.parametrize(
    ("failure", "what", "advice"),
    [
        (Failure.UNRESOLVED, "host name does not resolve", "/etc/hosts"),
        (Failure.DEAD, "no router listens there", "fleetsight monitor"),
        (Failure.REFUSED, "the bus cannot be joined: ", "--connect"),
        (Failure.FOREIGN, "does not answer as a Zenoh router does", "correct the port in --connect"),
        (Failure.SILENT, "no answer", "firewall"),
        (Failure.OFF, "no answer", "firewall"),
    ],
)
def test_no_router(failure: Failure, what: str, advice: str) -> None:
    (finding,) = said(routers=(router(failure),), robots=frozenset())
    assert (finding.severity, finding.subject) == (Severity.PROBLEM, CENTRAL)
    assert what in finding.what
    assert advice in finding.advice


def test_a_router_is_started_where_the_endpoint_says() -> None:
    (finding,) = said(routers=(router(Failure.DEAD, "tls/central:7448#x=1"),), robots=frozenset())
    assert "`fleetsight monitor --listen tls/0.0.0.0:7448`" in finding.advice


def test_a_router_that_is_not_joined_by_tls() -> None:
    (finding,) = said(routers=(router(Failure.FOREIGN, "tls/central:7447"),), robots=frozenset())
    assert (finding.severity, finding.subject) == (Severity.PROBLEM, "tls/central:7447")
    assert "no link with certificates" in finding.what
    assert "of the same authority" in finding.advice


def test_a_gateway_without_a_link_to_the_centre() -> None:
    routers = (router(Failure.DEAD), router(endpoint="tcp/127.0.0.1:7447"))
    look = BusLook(routers, frozenset({"r1"}), (one(),), at_home_only=True)
    endpoint, gateway, own = check_presence(evidence(bus=look))
    assert (endpoint.severity, endpoint.subject) == (Severity.PROBLEM, CENTRAL)
    assert (gateway.severity, gateway.subject) == (Severity.PROBLEM, "r1")
    assert "no link to its --connect endpoints" in gateway.what
    assert own.severity is Severity.OK


def test_one_of_two_routers_is_enough() -> None:
    findings = said(one(), routers=(router(Failure.DEAD), router(endpoint="tcp/other:7447")))
    assert [each.severity for each in findings] == [Severity.NOTE, Severity.OK]
    assert findings[0].subject == CENTRAL


def test_who_is_found_by_scouting_needs_no_router() -> None:
    assert [each.severity for each in said(one(), routers=(router(Failure.DEAD),))] == [Severity.NOTE, Severity.OK]


def test_found_by_scouting_alone() -> None:
    assert [each.severity for each in said(one(), routers=())] == [Severity.OK]


def test_nobody_on_the_bus() -> None:
    (finding,) = said(robots=frozenset())
    assert finding.severity is Severity.PROBLEM
    assert "no gateway of any robot" in finding.what


@pytest.mark.parametrize(
    ("robots", "advice"), [({"r2", "arm"}, "did you mean --robot r2?"), ({"arm"}, "start `fleetsight gateway")]
)
def test_other_robots_on_the_bus(robots: set[str], advice: str) -> None:
    (finding,) = said(robots=frozenset(robots))
    assert finding.severity is Severity.PROBLEM
    assert finding.what.endswith(", ".join(sorted(robots)))
    assert finding.advice.startswith(advice)


def test_a_gateway_that_says_nothing() -> None:
    (finding,) = said()
    assert finding.severity is Severity.PROBLEM
    assert "sent no status in 3 s" in finding.what


def test_two_gateways_of_one_name() -> None:
    findings = said(one(), one(since_s=0.5, until_s=2.5))
    assert findings[0].severity is Severity.PROBLEM
    assert "more than one gateway" in findings[0].what


def test_a_gateway_that_was_restarted_is_one_at_a_time() -> None:
    findings = said(one(), one(since_s=2.1, until_s=3.0))
    assert {each.severity for each in findings} == {Severity.OK}


def test_a_gateway_that_waits() -> None:
    waiting = status(waiting_for="the ROS master at http://robot:11311")
    (finding,) = said(account(waiting, waiting))
    assert finding.severity is Severity.PROBLEM
    assert finding.what == "the running gateway waits for the ROS master at http://robot:11311"


@pytest.mark.parametrize(("skew_s", "what"), [(1.0, ""), (-1.0, ""), (1.5, "1.5 s ahead of"), (-9.0, "9.0 s behind")])
def test_clocks_that_differ(skew_s: float, what: str) -> None:
    notes = [each for each in said(one(skew_s=skew_s)) if each.severity is Severity.NOTE]
    assert len(notes) == bool(what)
    assert all(what in each.what for each in notes)


def of(robot: str, **changes: Any) -> GatewayReport:
    offered = [counted("front/color", wanted=True), counted("front/depth")]
    return account(*(status(*offered, robot=robot, version="1.2", sent_s=s) for s in (0.0, 2.0)), **changes)


def test_the_robots_of_the_fleet() -> None:
    waiting = status(robot="r3", waiting_for="the ROS master at http://robot:11311")
    accounts = (of("r2"), of("r1"), account(waiting, waiting))
    told, *found = check_fleet(BusLook((router(),), frozenset({"r1", "r2", "r4"}), accounts), 3.0)
    assert (told.severity, told.what) == (Severity.NOTE, "is not given: these are the 4 robots on the bus")
    assert [(each.subject, each.severity, each.what) for each in found] == [
        ("r1", Severity.OK, "its gateway 1.2 offers 2 streams, of which 1 are wanted"),
        ("r2", Severity.OK, "its gateway 1.2 offers 2 streams, of which 1 are wanted"),
        ("r3", Severity.PROBLEM, "the running gateway waits for the ROS master at http://robot:11311"),
        ("r4", Severity.PROBLEM, "its gateway is present but sent no status in 3 s"),
    ]


def test_two_gateways_of_one_name_in_a_fleet() -> None:
    findings = check_fleet(BusLook((), frozenset({"r1"}), (of("r1"), of("r1"), of("r2"))), 3.0)
    assert [each.subject for each in findings if each.severity is Severity.PROBLEM] == ["r1"]


def test_a_fleet_without_robots_and_one_out_of_reach() -> None:
    (nobody,) = check_fleet(BusLook((router(),)), 3.0)
    assert (nobody.severity, nobody.what) == (Severity.PROBLEM, "no gateway of any robot is on this bus")
    assert "`fleetsight gateway --robot NAME`" in nobody.advice
    (unreached,) = check_fleet(BusLook((router(Failure.DEAD),)), 3.0)
    assert (unreached.severity, unreached.subject) == (Severity.PROBLEM, CENTRAL)
