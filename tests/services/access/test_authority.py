"""`fleetsight pki`: what it makes, OpenSSL checks."""

import gzip
import json
import os
import re
import stat
import subprocess
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from pydantic import ValidationError

from services.access.authority import Authority, AuthorityError
from services.access.process import AccessError, run_access, run_pki
from services.access.settings import AccessSettings, PkiSettings


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    made = Authority(tmp_path / "pki")
    made.make()
    return made


def openssl(*arguments: str | Path) -> str:
    return subprocess.run(["openssl", *arguments], check=True, capture_output=True, text=True).stdout


def verified(authority: Authority, certificate: Path) -> bool:
    command = ["openssl", "verify", "-x509_strict", "-CAfile", str(authority.folder / "ca.pem"), str(certificate)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def test_a_certificate_is_for_its_name_and_hosts_and_signs_no_others(authority: Authority) -> None:
    made = authority.issue("central", ["10.0.0.1", "central.example"], 90)
    assert verified(authority, made)
    text = openssl("x509", "-in", made, "-noout", "-text")
    assert "Subject: CN = central" in text
    names = "DNS:central, DNS:localhost, IP Address:127.0.0.1, IP Address:10.0.0.1, DNS:central.example"
    assert names in text
    assert "CA:FALSE" in text
    own = openssl("pkey", "-in", made.with_suffix(".key"), "-pubout")
    assert own == openssl("x509", "-in", made, "-noout", "-pubkey")


def test_nobody_else_may_read_a_key(authority: Authority) -> None:
    before = os.umask(0)
    try:
        made = authority.issue("r1", [], 90)
    finally:
        os.umask(before)
    for key in (made.with_suffix(".key"), authority.folder / "ca.key"):
        assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert stat.S_IMODE(authority.folder.stat().st_mode) == 0o700


def test_a_renewed_certificate_has_the_same_key_and_hosts_and_more_time(authority: Authority) -> None:
    made = authority.issue("r1", ["10.0.0.7"], 5)
    key = made.with_suffix(".key").read_bytes()
    before = next(each for each in authority.all() if each.name == "r1")
    authority.renew("r1", 90)
    after = next(each for each in authority.all() if each.name == "r1")
    assert made.with_suffix(".key").read_bytes() == key
    assert (after.hosts, after.until - before.until > timedelta(days=80)) == (before.hosts, True)
    assert verified(authority, made)


def test_what_the_authority_signed_is_good_after_its_own_renewal(authority: Authority) -> None:
    made = authority.issue("r1", [], 5)
    authority.renew("ca", 90)
    assert verified(authority, made)


def test_a_revoked_name_is_not_given_again_before_its_certificate_ends(authority: Authority) -> None:
    made = authority.issue("r1", [], 5)
    revoked = authority.revoke("r1")
    assert revoked.until > datetime.now(UTC)
    assert not made.exists()
    assert not made.with_suffix(".key").exists()
    with pytest.raises(
        AuthorityError, match=f"r1 is revoked, and that certificate is good until {revoked.until:%Y-%m-%d}"
    ):
        authority.issue("r1", [], 5)
    assert [each.name for each in authority.all() if each.revoked] == ["r1"]


def test_a_name_whose_revoked_certificate_has_ended_is_free(authority: Authority) -> None:
    authority.issue("r1", [], 0.001 / 86_400)
    authority.revoke("r1")
    assert verified(authority, authority.issue("r1", [], 5))


@pytest.mark.parametrize(
    ("act", "reason"),
    [
        (lambda of: of.make(), "a second authority would not know its certificates"),
        (lambda of: of.issue("r1", [], 1), "there is a certificate of r1: renew it, or revoke it"),
        (lambda of: of.issue("ca", [], 1), "ca is the authority's own name"),
        (lambda of: of.renew("r2", 1), "there is no certificate of r2"),
        (lambda of: of.revoke("r2"), "there is no certificate of r2"),
        (lambda of: Authority(of.folder / "other").issue("r1", [], 1), "`fleetsight pki init` makes one"),
        (lambda of: list(Authority(of.folder / "other").all()), "`fleetsight pki init` makes one"),
    ],
)
def test_what_cannot_be_done_is_told(authority: Authority, act: Callable[[Authority], object], reason: str) -> None:
    authority.issue("r1", [], 1)
    with pytest.raises(AuthorityError, match=re.escape(reason)):
        act(authority)


@pytest.mark.parametrize("file", ["ca.key", "ca.pem", "r1.pem"])
def test_a_damaged_file_is_named(authority: Authority, file: str) -> None:
    authority.issue("r1", [], 1)
    (authority.folder / file).write_text("garbage")
    with pytest.raises(AuthorityError, match=file):
        authority.renew("r1", 1)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o602])
def test_a_key_of_the_authority_s_that_others_may_use_is_refused(authority: Authority, mode: int) -> None:
    key = authority.folder / "ca.key"
    key.chmod(mode)
    with pytest.raises(
        AuthorityError, match=rf"ca\.key: others than its owner .*; run chmod go= {re.escape(str(key))}$"
    ):
        authority.issue("r1", [], 1)
    key.chmod(0o600)
    assert authority.issue("r1", [], 1).exists()


async def pki(folder: Path, *given: Mapping[str, object]) -> None:
    for each in given:
        await run_pki(PkiSettings.model_validate({**each, "folder": folder}))


async def test_the_commands_say_what_they_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "pki"
    await pki(folder, {"task": "init"}, {"task": "issue", "name": "r1", "days": 5})
    await pki(
        folder, *({"task": task, "name": name} for task, name in (("issue", "r2"), ("issue", "r3"), ("revoke", "r3")))
    )
    capsys.readouterr()
    await run_pki(PkiSettings(task="list", folder=folder))
    states = {line.split()[0]: line[25:36].strip() for line in capsys.readouterr().out.splitlines()}
    assert states == {"ca": "good", "r1": "renew soon", "r2": "good", "r3": "revoked"}
    await run_pki(PkiSettings(task="renew", folder=folder))
    assert capsys.readouterr().out == f"{folder}/r1.pem: renewed\n"
    await run_pki(PkiSettings(task="renew", folder=folder))
    assert capsys.readouterr().out == "none ends within 30 days\n"


async def test_a_failure_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(AccessError, match="pki init"):
        await run_pki(PkiSettings(task="list", folder=tmp_path))
    (tmp_path / "fleet.yaml").write_text("robots: [r2..r1]")
    with pytest.raises(AccessError, match=r"fleet.yaml, line 1: robots.0"):
        await run_access(AccessSettings(fleet=tmp_path / "fleet.yaml"))


async def test_a_fleet_file_gets_what_its_names_lack(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, fleet = tmp_path / "pki", tmp_path / "fleet.yaml"
    fleet.write_text("{robots: [r1..r3], roles: {central: monitor}, denied: [r3]}")
    await pki(folder, {"task": "init", "fleet": fleet, "days": 5})
    said = capsys.readouterr().out
    assert f"{folder}/NAME.pem, NAME.key: 3 new, good for 5 days: r1, r2, central\n{tmp_path}/access.json:" in said
    key = (folder / "r1.key").read_bytes()
    await pki(folder, {"task": "revoke", "name": "r2"}, {"task": "invite", "name": "lift"})
    fleet.write_text("{robots: [r1..r3, lift], roles: {central: monitor, gpu1: detector}, denied: [r3]}")
    capsys.readouterr()
    await pki(folder, {"task": "issue", "fleet": fleet})
    assert "1 new, good for 90 days: gpu1\n" in capsys.readouterr().out
    assert (folder / "r1.key").read_bytes() == key
    rules = json.loads((tmp_path / "access.json").read_bytes())
    assert {subject["id"] for subject in rules["subjects"]} == {"r1", "lift", "central", "gpu1"}
    await pki(folder, {"task": "issue", "fleet": fleet})
    assert "new" not in capsys.readouterr().out
    for wrong, why in (("{robots: [r1], roles: {r1: monitor}}", "fleet.yaml, line 1"), ("robots: [ca]", "own name")):
        fleet.write_text(wrong)
        with pytest.raises(AccessError, match=why):
            await pki(tmp_path / "other", {"task": "init", "fleet": fleet})
        assert not (tmp_path / "other").exists()


async def test_each_warehouse_has_rules_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, fleet = tmp_path / "pki", tmp_path / "fleet.yaml"
    fleet.write_text(
        "{roles: {ann: operator}, denied: [b2], warehouses:"
        " {berlin: {robots: [b1..b2], roles: {gpu1: detector}}, lyon: {robots: [l1]}}}"
    )
    await pki(folder, {"task": "init", "fleet": fleet})
    assert {file.stem for file in folder.glob("*.key")} == {"ca", "b1", "l1", "ann", "gpu1"}
    found = {}
    for warehouse in ("berlin", "lyon"):
        made = (tmp_path / f"access-{warehouse}.json").read_bytes()
        found[warehouse] = {subject["id"] for subject in json.loads(made)["subjects"]}
        capsys.readouterr()
        await run_access(AccessSettings(fleet=fleet, warehouse=warehouse))
        assert capsys.readouterr().out.encode() == made
    assert found == {"berlin": {"b1", "gpu1", "ann"}, "lyon": {"l1", "ann"}}
    for wrong in ("", "paris"):
        with pytest.raises(AccessError, match=rf"no warehouse '{wrong}' in it; there are berlin, lyon"):
            await run_access(AccessSettings(fleet=fleet, warehouse=wrong))
    fleet.write_text("{robots: [b1], warehouses: {berlin: {robots: [b1]}}}")
    with pytest.raises(AccessError, match="b1 is there twice"):
        await run_access(AccessSettings(fleet=fleet, warehouse="berlin"))


async def test_rules_of_thousands_of_robots_fit_where_a_mebibyte_does(tmp_path: Path) -> None:
    (tmp_path / "fleet.yaml").write_text("robots: [r1..r1000]")
    plain, packed = tmp_path / "access.json", tmp_path / "access.json.gz"
    for file in (plain, packed):
        await run_access(AccessSettings(fleet=tmp_path / "fleet.yaml", to=file))
    assert gzip.decompress(packed.read_bytes()) == plain.read_bytes()
    assert 5 * packed.stat().st_size < 1 << 20


async def test_rules_deny_who_is_revoked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "pki"
    tasks = (("issue", "r1"), ("issue", "other"), ("revoke", "r1"), ("revoke", "other"))
    await pki(folder, {"task": "init"}, *({"task": task, "name": name} for task, name in tasks))
    (tmp_path / "fleet.yaml").write_text("robots: [r1, r2]")
    capsys.readouterr()
    await run_access(AccessSettings(fleet=tmp_path / "fleet.yaml", folder=folder))
    said = capsys.readouterr().out
    assert '"r2"' in said
    assert '"r1"' not in said


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"task": "issue"}, "issue needs a name"),
        ({"task": "issue", "name": "r1", "fleet": Path(__file__)}, "issue needs a name, or --fleet for all"),
        ({"task": "issue", "fleet": Path(__file__), "hosts": ["a"]}, "--hosts is for one certificate"),
        ({"task": "init", "name": "r1"}, "init takes no --name"),
        ({"task": "init", "days": 5}, "init takes --days with --fleet alone"),
        ({"task": "revoke", "name": "r1", "days": 5}, "revoke takes no --days"),
        ({"task": "issue", "name": "a b"}, "certificate name 'a b'"),
        ({"task": "issue", "name": "r1", "hosts": ["a b"]}, "'a b' is neither a host's name nor an address"),
        ({"task": "issue", "name": "r1", "days": 900}, "less than or equal to 825"),
        ({"task": "invite"}, "invite needs a name"),
        ({"task": "serve", "at": "central:x"}, "'central:x' is no address; write it like central:7448"),
        ({"task": "enrol", "token": "r4:x:y"}, "enrol needs --at"),
        ({"task": "enrol", "at": "central", "renew": True}, "enrol --renew needs a name"),
        ({"task": "enrol", "at": "central", "token": "r4"}, "this is no token"),
        ({"task": "enrol", "at": "central", "token": "r4:x:y", "name": "r5"}, "the token is for r4, not for r5"),
        ({"task": "enrol", "at": "central", "token": "r4:x:y", "days": 5}, "enrol takes no --days"),
        ({"task": "enrol", "at": "central", "token": "r4:x:y", "folder": Path("x")}, "enrol takes no --folder"),
    ],
)
def test_settings_that_do_not_fit_are_refused(given: dict[str, object], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        PkiSettings.model_validate(given)
