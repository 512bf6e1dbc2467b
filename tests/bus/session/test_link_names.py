"""Names of links: those that rules do not know, and those that are used at two addresses."""

from bus.session.link_names import AT_ONCE_S, LinkNames

OWN = "tls/10.0.0.1:7447"
HERE, HERE_TOO, THERE = "tls/10.0.0.5:50000", "tls/10.0.0.5:50001", "tls/10.0.0.9:50000"


def made(*known: str) -> LinkNames:
    names = LinkNames()
    names.known = names.of_one_machine = known
    return names


def test_a_name_that_is_in_no_rule_is_news_once_and_a_problem_while_it_is_there() -> None:
    names = made("r1")
    assert not names.add(OWN, HERE, "r1", 0)
    assert names.add(OWN, THERE, "r2", 0)
    assert not names.add(OWN, HERE_TOO, "r2", 0)
    (problem,) = names.seen().problems(0)
    assert problem.startswith("certificate r2 connects, and the access rules let nobody of that name do anything")
    names.remove(OWN, THERE)
    assert names.seen().strangers == ("r2",)
    names.remove(OWN, HERE_TOO)
    assert names.seen().problems(0) == []


def test_without_rules_or_certificates_no_name_is_wrong() -> None:
    names = LinkNames()
    assert not names.add(OWN, HERE, "r1", 0)
    assert not names.add(OWN, THERE, "", 0)
    assert names.seen().problems(99) == []


def test_a_certificate_at_two_addresses_is_a_problem_after_a_while() -> None:
    names = made("r1")
    for other in (HERE, HERE_TOO):
        names.add(OWN, other, "r1", 0)
    assert names.seen().copied(99) == []
    names.add(OWN, THERE, "r1", 100)
    assert names.seen().copied(100 + AT_ONCE_S - 1) == []
    assert names.seen().copied(100 + AT_ONCE_S) == ["r1"]
    (problem,) = names.seen().problems(100 + AT_ONCE_S)
    assert "certificate r1 is used at 10.0.0.5 and 10.0.0.9 at once" in problem
    names.remove(OWN, HERE)
    names.remove(OWN, HERE_TOO)
    assert names.seen().problems(200) == []


def test_this_machine_is_one_whatever_its_loopback_is_called() -> None:
    names = made("r1")
    for other in ("tls/127.0.0.1:50000", "tls/[::1]:50000"):
        names.add(OWN, other, "r1", 0)
    assert names.seen().copied(99) == []


def test_workers_may_share_a_certificate() -> None:
    names = made("r1", "gpu1")
    names.of_one_machine = {"r1"}
    for other in (HERE, THERE):
        names.add(OWN, other, "gpu1", 0)
    assert names.seen().problems(99) == []
