"""A machine enrols with a token over real TLS, and renews what it got."""

import asyncio
import os
import shutil
import stat
from collections.abc import AsyncIterator
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from services.access import certificates, enrolment_server
from services.access.authority import Authority, AuthorityError
from services.access.certificates import common_name_of, hosts_of, pem_of, public_bytes
from services.access.enrolment_client import EnrolmentError
from services.access.enrolment_protocol import SERVER_NAME, Token
from services.access.invitations import Invitations
from tests.services.access.enrolling import Serving, new_authority, serving


@pytest.fixture
async def served(tmp_path: Path) -> AsyncIterator[Serving]:
    async with serving(new_authority(tmp_path / "pki"), tmp_path / "fleet.yaml") as served:
        (tmp_path / "fleet.yaml").write_text("robots: [r1..r9]\ndenied: [r3]\n")
        yield served


async def test_the_key_is_made_where_it_stays(served: Serving, tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        made = await served.enrol(served.invite("r4"), tmp_path / "tls")
    finally:
        os.umask(before)
    folder = tmp_path / "tls"
    assert sorted(file.name for file in folder.iterdir()) == ["ca.pem", "r4.key", "r4.pem"]
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE((folder / "r4.key").stat().st_mode) == 0o600
    key = load_pem_private_key((folder / "r4.key").read_bytes(), None)
    assert public_bytes(made.public_key()) == public_bytes(key.public_key())  # type: ignore[arg-type]
    assert (common_name_of(made.subject), hosts_of(made)) == ("r4", ("r4", "localhost", "127.0.0.1"))
    assert (folder / "ca.pem").read_bytes() == (tmp_path / "pki/ca.pem").read_bytes()
    assert not (tmp_path / "pki/r4.key").exists()
    assert [issued.name for issued in served.authority.all()] == ["ca", "r4"]


async def test_the_authority_keeps_no_secret(served: Serving, tmp_path: Path) -> None:
    token = served.invite("r4")
    kept = tmp_path / "pki/invitations/r4.json"
    assert token.secret not in kept.read_text()
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600


async def test_of_two_machines_with_one_token_one_enrols(served: Serving, tmp_path: Path) -> None:
    token = served.invite("r4")
    tries = [served.enrol(token, tmp_path / f"tls{number}") for number in range(6)]
    ended = await asyncio.gather(*tries, return_exceptions=True)
    (made,) = [each for each in ended if isinstance(each, x509.Certificate)]
    refused = [str(each) for each in ended if isinstance(each, EnrolmentError)]
    assert len(refused) == 5
    assert all("the token was used at" in reason and "from 127.0.0.1. If that was none" in reason for reason in refused)
    (kept,) = [file for number in range(6) for file in (tmp_path / f"tls{number}").iterdir() if file.suffix == ".key"]
    assert x509.load_pem_x509_certificate(kept.with_suffix(".pem").read_bytes()) == made


@pytest.mark.parametrize(
    ("token", "reason"),
    [
        (lambda of: of.invite("r4", hours=-0.1), "good until .* `fleetsight pki invite r4` at the authority"),
        (lambda of: Token("r4", "guessed", of.invite("r4").authority), "the token is not, or no longer, that of r4"),
        (lambda of: [of.invite("r4"), of.invite("r4")][0], "the token is not, or no longer, that of r4"),
        (lambda of: Token("r5", of.invite("r4").secret, of.authority.fingerprint()), "not, or no longer, that of r5"),
        (lambda of: of.invite("r3"), "r3 is denied in fleet.yaml"),
    ],
    ids=["expired", "guessed", "replaced", "of another name", "denied"],
)  # fmt: skip
async def test_a_token_that_lets_nobody_in(served: Serving, tmp_path: Path, token: object, reason: str) -> None:
    with pytest.raises(EnrolmentError, match=reason):
        await served.enrol(token(served), tmp_path / "tls")  # type: ignore[operator]
    assert not list((tmp_path / "tls").iterdir())
    assert [issued.name for issued in served.authority.all()] == ["ca"]


async def test_a_withdrawn_invitation_lets_nobody_in(served: Serving, tmp_path: Path) -> None:
    token = served.invite("r4")
    assert Invitations(served.authority).withdraw("r4")
    with pytest.raises(EnrolmentError, match="no longer, that of r4"):
        await served.enrol(token, tmp_path / "tls")


async def test_another_authority_in_between_learns_nothing(
    served: Serving, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    token = served.invite("r4")
    async with serving(new_authority(tmp_path / "other")) as other:
        with pytest.raises(EnrolmentError, match="is another authority than the token's"):
            await other.enrol(token, tmp_path / "tls")
    assert "refused" not in caplog.text  # nothing but the question for its certificate reached it
    assert not list((tmp_path / "tls").iterdir())
    await served.enrol(token, tmp_path / "tls")  # the token is still good


async def test_an_authority_that_comes_behind_the_right_one_is_not_believed(
    served: Serving, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    token = served.invite("r4")
    right = pem_of(served.authority.certificate()).decode()
    monkeypatch.setattr(enrolment_server, "pem_of", lambda own: right.encode() + pem_of(own))
    async with serving(new_authority(tmp_path / "other")) as other:
        with pytest.raises(EnrolmentError, match="certificate is not accepted"):
            await other.enrol(token, tmp_path / "tls")
    assert not list((tmp_path / "tls").iterdir())
    await served.enrol(token, tmp_path / "tls")
    assert (tmp_path / "tls/ca.pem").read_text(encoding="utf-8") == right


async def test_a_machine_of_the_fleet_cannot_pose_as_the_authority(
    served: Serving, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    token = served.invite("r4")
    own = served.authority.issue("r1", ["127.0.0.1"], 1)
    stolen = own.read_bytes(), own.with_suffix(".key").read_bytes()
    monkeypatch.setattr(Authority, "certificate_of_server", lambda _self, _days: stolen)
    async with serving(served.authority) as posing:
        with pytest.raises(EnrolmentError, match=f"certificate is not accepted: Hostname mismatch.*{SERVER_NAME}"):
            await posing.enrol(token, tmp_path / "tls")


@pytest.mark.parametrize("host", [SERVER_NAME, f"{SERVER_NAME.upper()}."])
def test_nobody_gets_the_server_s_name(tmp_path: Path, host: str) -> None:
    authority = new_authority(tmp_path / "pki")
    for name, hosts in ((host, []), ("r4", [host])):
        with pytest.raises(AuthorityError, match="is the name of `fleetsight pki serve`"):
            authority.issue(name, hosts, 1)


async def test_an_authority_that_cannot_write_says_so(
    served: Serving, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "pki/.r4.pem").mkdir()
    with pytest.raises(EnrolmentError, match="refuses: the authority cannot use its files; its log says why"):
        await served.enrol(served.invite("r4"), tmp_path / "tls")
    assert f"{tmp_path}/pki/.r4.pem: Is a directory" in caplog.text
    assert not list((tmp_path / "tls").iterdir())


async def test_files_that_are_there_stay(served: Serving, tmp_path: Path) -> None:
    await served.enrol(served.invite("r4"), tmp_path / "tls")
    before = {file: file.read_bytes() for file in (tmp_path / "tls").iterdir()}
    with pytest.raises(EnrolmentError, match=r"r4\.pem is there: renew it with --renew"):
        await served.enrol(served.invite("r4", replace=True), tmp_path / "tls")
    async with serving(new_authority(tmp_path / "other")) as other:
        with pytest.raises(EnrolmentError, match=r"ca\.pem is another authority's than the token's"):
            await other.enrol(other.invite("r5"), tmp_path / "tls")
    assert {file: file.read_bytes() for file in (tmp_path / "tls").iterdir()} == before


async def test_a_name_is_given_twice_only_where_asked_for(served: Serving, tmp_path: Path) -> None:
    served.authority.issue("r4", [], 7)  # with a key at the authority, as before there were tokens
    with pytest.raises(AuthorityError, match="there is a certificate of r4"):
        served.invite("r4")
    await served.enrol(served.invite("r4", replace=True), tmp_path / "tls")
    assert not (tmp_path / "pki/r4.key").exists()
    assert (tmp_path / "pki/r4.pem").read_bytes() == (tmp_path / "tls/r4.pem").read_bytes()


async def test_a_renewed_certificate_has_the_same_key(served: Serving, tmp_path: Path) -> None:
    made, folder = await served.enrol(served.invite("r4"), tmp_path / "tls"), tmp_path / "tls"
    key, authority = (folder / "r4.key").read_bytes(), (folder / "ca.pem").read_bytes()
    assert await served.renew("r4", folder, after=timedelta(days=4)) is None
    served.authority.renew("ca", 1)
    served.authority.renew("r4", 90)  # with the others at the authority; the machine does not get this one
    renewed = await served.renew("r4", folder)
    assert renewed is not None
    assert x509.load_pem_x509_certificate((folder / "r4.pem").read_bytes()) == renewed != made
    assert public_bytes(renewed.public_key()) == public_bytes(made.public_key())
    assert renewed.not_valid_after_utc - made.not_valid_after_utc < timedelta(days=1)  # as many days as it had
    assert (folder / "r4.key").read_bytes() == key
    assert (folder / "ca.pem").read_bytes() == (tmp_path / "pki/ca.pem").read_bytes() != authority
    assert await served.renew("r4", folder) is not None


async def test_a_certificate_whose_key_was_copied_is_renewed_too(served: Serving, tmp_path: Path) -> None:
    made = served.authority.issue("r1", ["10.0.0.7"], 7)
    (tmp_path / "tls").mkdir()
    for file in (made, made.with_suffix(".key"), made.with_name("ca.pem")):
        shutil.copy(file, tmp_path / "tls")
    (tmp_path / "tls/r1.key").chmod(0o644)
    with pytest.raises(EnrolmentError, match=r"r1\.key: everybody on this machine may use it; run chmod o="):
        await served.renew("r1", tmp_path / "tls")
    (tmp_path / "tls/r1.key").chmod(0o600)
    renewed = await served.renew("r1", tmp_path / "tls")
    assert renewed is not None
    assert hosts_of(renewed) == ("r1", "localhost", "127.0.0.1", "10.0.0.7")


async def test_a_clock_that_is_behind_is_told(served: Serving, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    token = served.invite("r4")
    monkeypatch.setattr(certificates, "EARLIER", timedelta(hours=-1))
    async with serving(served.authority) as ahead:
        with pytest.raises(EnrolmentError, match=r"not yet valid; check --at, and this machine's clock"):
            await ahead.enrol(token, tmp_path / "tls")


async def test_renewal_is_refused(served: Serving, tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    for name in ("r4", "r5", "r6"):
        await served.enrol(served.invite(name), folder)
    served.authority.revoke("r4")
    await served.enrol(served.invite("r5", replace=True), tmp_path / "again")
    (tmp_path / "fleet.yaml").write_text("robots: [r1..r9]\ndenied: [r6]\n")
    for name, reason in {
        "r4": "r4 is revoked",
        "r5": "another machine has enrolled as r5 since",
        "r6": "r6 is denied in fleet.yaml",
        "r7": r"r7\.pem is not there: enrol with a token first",
    }.items():
        with pytest.raises(EnrolmentError, match=reason):
            await served.renew(name, folder)
    (tmp_path / "fleet.yaml").write_text("robots: [r9..r1]")
    with pytest.raises(EnrolmentError, match=r"fleet\.yaml at the authority cannot be used"):
        await served.renew("r6", folder)
    with pytest.raises(EnrolmentError, match=r"r6\.pem ended at .* `fleetsight pki invite r6 --replace`"):
        await served.renew("r6", folder, after=timedelta(days=8))
    assert await served.renew("r5", tmp_path / "again", after=timedelta(0)) is None


async def test_another_authority_s_certificate_is_not_renewed(served: Serving, tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    async with serving(new_authority(tmp_path / "other")) as other:
        await other.enrol(other.invite("r4"), folder)
        with pytest.raises(EnrolmentError, match="not accepted: self-signed certificate in certificate chain"):
            await served.renew("r4", folder)
    (folder / "ca.pem").write_bytes((tmp_path / "pki/ca.pem").read_bytes())
    with pytest.raises(EnrolmentError, match=r"r4\.pem is not of the authority of .*ca\.pem"):
        await served.renew("r4", folder)
