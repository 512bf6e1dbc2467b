import pytest

from bus import BusSettings
from bus.session.links import Links, host_of

OWN = "tcp/127.0.0.1:50000"


def links(*connect: str) -> Links:
    return Links(BusSettings(mode="peer", connect=list(connect)))


def test_only_a_link_that_was_sought_is_one() -> None:
    there = links("tcp/central:7447")
    assert not there.add("tcp/10.0.0.2:7447", "tcp/10.0.0.9:50001")
    assert (bool(there), there.missing()) == (False, ["tcp/central:7447"])
    assert there.add(OWN, "tcp/10.0.0.1:7447")
    assert (bool(there), there.missing()) == (True, [])
    assert not there.remove("tcp/10.0.0.2:7447", "tcp/10.0.0.9:50001")
    assert there.remove(OWN, "tcp/10.0.0.1:7447")
    assert not there


@pytest.mark.parametrize(
    ("connect", "missing"),
    [
        (["tcp/10.0.0.1:7447", "tcp/10.0.0.2:7447"], ["tcp/10.0.0.2:7447"]),
        (["tcp/10.0.0.1:7447", "tcp/10.0.0.1:7448"], ["tcp/10.0.0.1:7448"]),
        (["tcp/[fd00::1]:7447#iface=eth0", "tcp/10.0.0.1:7447"], ["tcp/[fd00::1]:7447#iface=eth0"]),
        (["tcp/central:7447", "tcp/spare:7448"], ["tcp/spare:7448"]),
        (["tcp/central:7447", "tcp/spare:7447"], []),  # nobody can tell which of both it is
        (["tcp/0.0.0.0:7447"], []),
    ],
)
def test_of_several_those_without_a_link_are_missing(connect: list[str], missing: list[str]) -> None:
    there = links(*connect)
    assert there.missing() == connect
    there.add(OWN, "tcp/10.0.0.1:7447")
    assert there.missing() == missing


@pytest.mark.parametrize(
    ("end", "host"),
    [
        ("tcp/central:7447", "central"),
        ("tls/10.0.0.1:7447?rel=0#iface=eth0", "10.0.0.1"),
        ("tcp/[::1]:7447", "::1"),
    ],
)
def test_the_host_of_an_end(end: str, host: str) -> None:
    assert host_of(end) == host
