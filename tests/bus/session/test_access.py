"""A router's rules, and that nobody is let in by default."""

import gzip
import json
from pathlib import Path

import pytest

from bus import BusError, BusSettings, open_bus
from bus.session.access import check_closed, names_in, of_one_machine, open_endpoints, read_access
from bus.session.certificates import check_certificates
from services.access.fleet_file import read_fleet
from services.access.rules import access_control
from tests.bus.certificates import certificate, make_certificates


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("access") / "pki"
    make_certificates(folder)
    (folder / "access.json").write_text(
        '{"enabled": true, "default_permission": "deny", "rules": [], "subjects": [], "policies": []}'
    )
    return folder


def settings(fleet: Path, *listen: str, **more: object) -> BusSettings:
    return BusSettings.model_validate({"mode": "router", "listen": listen, **certificate(fleet, "central"), **more})


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/localhost:7447", "tcp/0.0.0.0:7447#iface=lo", "tls/127.0.0.1:7447"],
)
def test_a_listener_on_loopback_needs_nothing(fleet: Path, endpoint: str) -> None:
    check_closed(settings(fleet, endpoint))


@pytest.mark.parametrize("endpoint", ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/10.0.0.1:7447", "ws/central:7447"])
def test_any_other_lets_nobody_in_without_certificates(fleet: Path, endpoint: str) -> None:
    rules = fleet / "access.json"
    for given in (settings(fleet, "tcp/127.0.0.1:1", endpoint), settings(fleet, endpoint, access=rules)):
        assert open_endpoints(given) == [endpoint]
        with pytest.raises(BusError, match=r"anybody who reaches it .* use tls/ and --access .* or --insecure"):
            check_closed(given)
    check_closed(settings(fleet, endpoint, insecure=True))


@pytest.mark.parametrize("endpoint", ["tls/0.0.0.0:7447", "quic/central:7447"])
def test_certificates_alone_do_not_say_who_is_who(fleet: Path, endpoint: str) -> None:
    with pytest.raises(BusError, match=r"could send as any robot; give rules with --access"):
        check_closed(settings(fleet, endpoint))
    closed = settings(fleet, endpoint, access=fleet / "access.json")
    check_closed(closed)
    assert open_endpoints(closed) == []
    assert read_access(closed) == {
        "enabled": True,
        "default_permission": "deny",
        "rules": [],
        "subjects": [],
        "policies": [],
    }


async def test_a_process_that_would_let_everybody_in_does_not_start() -> None:
    with pytest.raises(BusError, match=r"listen tcp/0\.0\.0\.0:0: anybody who reaches it"):
        async with open_bus(BusSettings(mode="router", listen=["tcp/0.0.0.0:0"])):
            pass


@pytest.mark.parametrize(("text", "reason"), [("{", "no JSON"), ("[]", "no rules"), ('{"enabled": true}', "no rules")])
def test_what_is_no_rules_says_how_they_are_made(fleet: Path, tmp_path: Path, text: str, reason: str) -> None:
    file = tmp_path / "mine.json"
    file.write_text(text)
    with pytest.raises(BusError, match=rf"access {file}: {reason}; `fleetsight access fleet\.yaml --to mine\.json`"):
        read_access(settings(fleet, "tls/127.0.0.1:7447", access=file))


def test_rules_may_be_compressed(fleet: Path, tmp_path: Path) -> None:
    file, rules = tmp_path / "access.json", (fleet / "access.json").read_bytes()
    file.write_bytes(gzip.compress(rules))
    given = settings(fleet, "tls/127.0.0.1:7447", access=file)
    assert read_access(given) == json.loads(rules)
    file.write_bytes(gzip.compress(rules)[:-9])
    with pytest.raises(BusError, match=rf"access {file}: its compression is damaged: "):
        read_access(given)


def test_a_key_that_everybody_may_read_is_refused(fleet: Path, tmp_path: Path) -> None:
    key = tmp_path / "r1.key"
    key.write_bytes((fleet / "r1.key").read_bytes())
    given = BusSettings.model_validate({**certificate(fleet, "r1"), "tls_key": key})
    for mode in (0o600, 0o640, 0o400):
        key.chmod(mode)
        check_certificates(given)
    for mode in (0o644, 0o604, 0o602):
        key.chmod(mode)
        with pytest.raises(BusError, match=f"tls_key {key}: everybody on this machine may read it; run chmod o= {key}"):
            check_certificates(given)


def test_all_certificates_but_workers_are_for_one_machine() -> None:
    rules = access_control(
        read_fleet(
            """
robots: [r1, r2]
roles:
  central: [monitor, worldmodel]
  second: [router, detector]
  alone: monitor
  ann: operator
  bob: [operator, space]
  wall: observer
  berlin: warehouse
  gpu1: detector
  rack1: space
  world1: worldmodel
  both: [detector, space]
"""
        )
    )
    one = {"r1", "r2", "central", "second", "alone", "ann", "bob", "wall", "berlin"}
    assert of_one_machine(rules) == one
    assert names_in(rules) - one == {"gpu1", "rack1", "world1", "both"}


def test_rules_that_somebody_wrote_are_read_as_far_as_they_go() -> None:
    bare = {"subjects": [{"id": "a", "cert_common_names": ["r1"]}, {"id": "b"}], "rules": None}
    assert of_one_machine({**bare, "policies": None}) == frozenset()
    assert of_one_machine({**bare, "policies": [{"subjects": ["a", "b", "c"], "rules": ["none"]}, {}]}) == {"r1"}
