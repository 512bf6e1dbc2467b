from pathlib import Path

import pytest

from fleetsight import CertificateError, SettingsError
from fleetsight.settings import settings_of


def test_without_arguments_and_variables_it_is_the_monitor_on_this_machine() -> None:
    assert settings_of({}, {}).connect == ["tcp/127.0.0.1:7447"]


@pytest.mark.parametrize("text", ["tcp/a:1, tcp/b:2", '["tcp/a:1", "tcp/b:2"]'])
def test_variables_are_read_as_the_commands_read_them(text: str) -> None:
    found = settings_of({}, {"FLEETSIGHT_CONNECT": text, "FLEETSIGHT_LEASE_S": "5", "FLEETSIGHT_ROBOT": "r1"})
    assert (found.connect, found.lease_s) == (["tcp/a:1", "tcp/b:2"], 5.0)


def test_the_environment_of_the_process_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEETSIGHT_CONNECT", "tcp/a:1")
    assert settings_of({}).connect == ["tcp/a:1"]


def test_arguments_count_before_variables() -> None:
    assert settings_of({"connect": ["tcp/b:2"]}, {"FLEETSIGHT_CONNECT": "tcp/a:1"}).connect == ["tcp/b:2"]


def test_a_variable_can_make_it_a_scout() -> None:
    found = settings_of({}, {"FLEETSIGHT_SCOUTING": "true"})
    assert (found.scouting, found.connect) == (True, [])


@pytest.mark.parametrize(
    ("arguments", "variables", "said"),
    [
        (
            {"connect": ["central:7447"]},
            {},
            "connect: 'central:7447' is not an endpoint; write it like tcp/192.168.0.1:7447",
        ),
        ({}, {"FLEETSIGHT_CONNECT": "[1]"}, "FLEETSIGHT_CONNECT: '[1]' is not an endpoint; write it like"),
        ({}, {"FLEETSIGHT_LEASE_S": "0"}, "FLEETSIGHT_LEASE_S '0': Input should be greater than or equal to 0.5"),
        ({"connect": ["tls/a:1"]}, {}, "tls_ca: tls/ and quic/ endpoints need tls_ca, tls_certificate, tls_key"),
    ],
)
def test_what_cannot_be_is_named_as_it_was_given(
    arguments: dict[str, object], variables: dict[str, str], said: str
) -> None:
    with pytest.raises(SettingsError) as refusal:
        settings_of(arguments, variables)
    assert str(refusal.value).startswith(said)


def test_a_file_that_is_absent_is_named(tmp_path: Path) -> None:
    absent = tmp_path / "ca.pem"
    with pytest.raises(CertificateError) as refusal:
        settings_of({"tls_ca": absent}, {})
    assert str(refusal.value) == f"tls_ca {absent}: No such file or directory; name the file of it, in PEM"
    with pytest.raises(CertificateError, match=r"^FLEETSIGHT_TLS_KEY "):
        settings_of({}, {"FLEETSIGHT_TLS_KEY": str(absent)})
