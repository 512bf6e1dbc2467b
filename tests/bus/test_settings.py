from pathlib import Path

import pytest
from pydantic import ValidationError

from bus import BusSettings
from bus.settings import port_of


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/[::1]:65535",
        "tls/router.example:7447",
        "quic/10.0.0.1:1",
        "tcp/10.0.0.1:7447#iface=eth0",
        "udp/10.0.0.1:7447?rel=0",
    ],
)
def test_an_endpoint_is_taken_as_it_is(endpoint: str) -> None:
    files = {"tls_ca": __file__, "tls_certificate": __file__, "tls_key": __file__}
    assert BusSettings.model_validate({"connect": [endpoint], **files}).connect == [endpoint]


@pytest.mark.parametrize("field", ["connect", "listen"])
@pytest.mark.parametrize(
    "endpoint",
    ["", "7447", "127.0.0.1:7447", "tcp/127.0.0.1", "tcp/:7447", "tcp/a:65536", "tcp/a:x", "http/a:80", "tcp/a b:1"],
)
def test_a_wrong_endpoint_is_one_error_that_names_the_field(field: str, endpoint: str) -> None:
    with pytest.raises(ValidationError) as caught:
        BusSettings.model_validate({"mode": "peer", field: [endpoint]})
    (error,) = caught.value.errors()
    assert error["loc"] == (field, 0)
    assert "not an endpoint" in error["msg"]


@pytest.mark.parametrize(
    ("settings", "location"),
    [
        ({"mode": "router"}, ("listen",)),
        ({"connect": ["tcp/127.0.0.1:0"]}, ("connect",)),
        ({"mode": "server"}, ("mode",)),
        ({"lease_s": 0.1}, ("lease_s",)),
    ],
)
def test_a_wrong_setting_is_one_error_that_names_the_field(settings: dict[str, object], location: tuple[str]) -> None:
    with pytest.raises(ValidationError) as caught:
        BusSettings.model_validate(settings)
    assert [error["loc"] for error in caught.value.errors()] == [location]


def test_a_client_needs_somebody_to_connect_to() -> None:
    with pytest.raises(ValidationError, match="connect"):
        BusSettings(connect=[])
    assert BusSettings(connect=[], scouting=True).connect == []
    with pytest.raises(ValidationError, match="a client that listens needs an endpoint to connect to"):
        BusSettings(listen=["tcp/127.0.0.1:7447"], scouting=True)


def test_a_client_to_which_others_connect_has_more_than_one_link() -> None:
    listen = ["tcp/127.0.0.1:7447"]
    alone, serving, hub = BusSettings(), BusSettings(listen=listen), BusSettings(mode="router", listen=listen)
    assert [each.has_one_link for each in (alone, serving, hub)] == [True, False, False]
    assert [each.is_listening_client for each in (alone, serving, hub)] == [False, True, False]


def test_a_router_connects_only_where_it_is_told() -> None:
    listen = ["tcp/127.0.0.1:7447"]
    assert BusSettings(mode="router", listen=listen).connect == []
    assert BusSettings(mode="router", listen=listen, connect=["tcp/10.0.0.1:7447"]).connect == ["tcp/10.0.0.1:7447"]


def test_who_scouts_connects_by_address_only_where_it_is_told() -> None:
    assert BusSettings(scouting=True).connect == []
    assert BusSettings(scouting=True, connect=["tcp/10.0.0.1:7447"]).connect == ["tcp/10.0.0.1:7447"]


def test_every_field_explains_itself() -> None:
    assert all(field.description for field in BusSettings.model_fields.values())


@pytest.mark.parametrize(
    ("given", "missing"),
    [
        ({"connect": ["tls/central:7447"]}, "tls_ca"),
        ({"connect": ["tls/central:7447"], "tls_ca": __file__}, "tls_certificate"),
        ({"mode": "peer", "listen": ["quic/0.0.0.0:7447"]}, "tls_ca"),
        ({"tls_ca": __file__, "tls_certificate": __file__}, "tls_key"),
    ],
)
def test_certificates_go_together(given: dict[str, object], missing: str) -> None:
    with pytest.raises(ValidationError, match=f"{missing}: "):
        BusSettings.model_validate(given)


@pytest.mark.parametrize(
    ("file", "reason"),
    [("/no/such/file", "No such file or directory"), ("/proc", "not a file"), (f"/{'x' * 300}", "File name too long")],
)
def test_a_file_that_is_none_is_one_error_that_names_the_field(file: str, reason: str) -> None:
    with pytest.raises(ValidationError) as caught:
        BusSettings.model_validate({"tls_ca": __file__, "tls_certificate": __file__, "tls_key": file})
    (error,) = caught.value.errors()
    assert (error["loc"], error["msg"]) == (("tls_key",), f"Value error, {reason}")


@pytest.mark.parametrize("end", ["tcp/a:7447", "tcp/[::1]:7447", "udp/10.0.0.1:7447?rel=0", "tls/a:7447#a=b:1"])
def test_an_endpoints_port(end: str) -> None:
    assert port_of(end) == "7447"


def test_one_setting_stands_for_the_files_that_the_command_makes(tmp_path: Path) -> None:
    for name in ("ca.pem", "gpu-1.local.pem", "gpu-1.local.key"):
        (tmp_path / name).touch()
    settings = BusSettings(connect=["tls/central:7447"], tls=tmp_path / "gpu-1.local")
    found = (settings.tls_ca, settings.tls_certificate, settings.tls_key)
    assert found == tuple(tmp_path / name for name in ("ca.pem", "gpu-1.local.pem", "gpu-1.local.key"))
    other = BusSettings(connect=["tls/central:7447"], tls=tmp_path / "gpu-1.local", tls_ca=Path(__file__))
    assert (other.tls_ca, other.tls_key) == (Path(__file__), tmp_path / "gpu-1.local.key")


def test_a_file_that_it_stands_for_and_that_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "ca.pem").touch()
    with pytest.raises(ValidationError) as caught:
        BusSettings(tls=tmp_path / "r1")
    assert [error["loc"] for error in caught.value.errors()] == [("tls_certificate",), ("tls_key",)]


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"mode": "client"}, "a client that does not listen applies no rules"),
        ({"mode": "peer"}, "the rules are by certificate"),
    ],
)
def test_rules_are_for_who_takes_links_with_certificates(given: dict[str, object], reason: str) -> None:
    files = {} if given["mode"] == "peer" else {"tls_ca": __file__, "tls_certificate": __file__, "tls_key": __file__}
    with pytest.raises(ValidationError, match=reason):
        BusSettings.model_validate({**given, **files, "access": __file__})
