"""Requests to `fleetsight pki serve` that other programs than `fleetsight pki enrol` make, and its limits."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa

from services.access import enrolment_server
from services.access.certificates import common_name_of, hosts_of, name_of
from services.access.enrolment_client import EnrolmentError
from services.access.enrolment_protocol import MAX_BYTES, Enrolled, EnrolRequest, Refusal, Token
from services.access.enrolment_server import MAX_ADDRESSES, MAX_REFUSED, REFUSED_S, RefusedAttempts
from tests.services.access.enrolling import Serving, Stream, new_authority, serving
from tests.waiting import until


@pytest.fixture
async def served(tmp_path: Path) -> AsyncIterator[Serving]:
    async with serving(new_authority(tmp_path / "pki")) as served:
        yield served


def request(name: str, key: ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey | None = None) -> str:
    """Return a signing request that asks for more than a name."""
    asked = x509.CertificateSigningRequestBuilder().subject_name(name_of(name))
    asked = asked.add_extension(x509.SubjectAlternativeName([x509.DNSName("central")]), critical=False)
    asked = asked.add_extension(x509.BasicConstraints(ca=True, path_length=9), critical=True)
    made = asked.sign(key or ec.generate_private_key(ec.SECP256R1()), hashes.SHA256())
    return made.public_bytes(serialization.Encoding.PEM).decode()


def message(content: bytes, *, path: str = "/enrol", size: int | None = None) -> bytes:
    head = f"POST {path} HTTP/1.1\r\nHost: x\r\nContent-Length: {len(content) if size is None else size}\r\n\r\n"
    return head.encode() + content


async def answer_of(stream: Stream, sent: bytes) -> tuple[int, bytes]:
    """Return the status and body of the answer to raw bytes."""
    reader, writer = stream
    try:
        writer.write(sent)
        head, _, body = (await asyncio.wait_for(reader.read(), 60)).partition(b"\r\n\r\n")
    finally:
        writer.close()
    return int(head.split()[1]), body


async def refused(served: Serving, sent: bytes) -> tuple[int, str]:
    status, body = await answer_of(await served.connect_tls(), sent)
    return status, msgspec.json.decode(body, type=Refusal).error


def asking(token: Token, text: str) -> bytes:
    return msgspec.json.encode(EnrolRequest(token.name, token.secret, text))


async def test_a_request_gets_the_invitation_s_name_and_hosts_and_no_others(served: Serving) -> None:
    token = served.invite("r4")
    status, body = await answer_of(await served.connect_tls(), message(asking(token, request("r4"))))
    made = x509.load_pem_x509_certificate(msgspec.json.decode(body, type=Enrolled).certificate.encode())
    assert (status, common_name_of(made.subject), hosts_of(made)) == (200, "r4", ("r4", "localhost", "127.0.0.1"))
    assert not made.extensions.get_extension_for_class(x509.BasicConstraints).value.ca


async def test_a_request_that_does_not_fit_is_refused_and_the_token_stays_good(served: Serving, tmp_path: Path) -> None:
    token = served.invite("r4")
    other_curve = ec.generate_private_key(ec.SECP384R1())
    damaged = request("r4").replace("\nMII", "\nMIJ", 1)
    for text, expected in {
        request("central"): (403, "the request is for 'central', the token for r4"),
        request("r4", other_curve): (400, "a request must be signed with an elliptic curve key, P-256, of its own"),
        request("r4", rsa.generate_private_key(65_537, 2_048)): (400, "a request must be signed with an elliptic"),
        damaged: (400, "no certificate signing request can be read"),
        "none": (400, "no certificate signing request can be read"),
    }.items():
        status, reason = await refused(served, message(asking(token, text)))
        assert (status, reason[: len(expected[1])]) == expected
    assert [issued.name for issued in served.authority.all()] == ["ca"]
    await served.enrol(token, tmp_path / "tls")


@pytest.mark.parametrize(
    ("sent", "status", "reason"),
    [
        (message(b"{}"), 400, "no request can be read from what came: Object missing required field"),
        (message(b"\xff"), 400, "no request can be read"),
        (message(msgspec.json.encode(EnrolRequest("../ca", "x", ""))), 400, "no request can be read"),
        (message(b"", path="/renew"), 401, "no certificate came"),
        (message(b"", path="/page"), 404, "this is for `fleetsight pki enrol` alone"),
        (message(b"x" * (MAX_BYTES + 1)), 413, f"the request has more than {MAX_BYTES} bytes"),
    ],
    ids=["empty", "no text", "a path for a name", "renewal without", "elsewhere", "too large"],
)
async def test_what_is_no_request_is_refused(served: Serving, sent: bytes, status: int, reason: str) -> None:
    found, said = await refused(served, sent)
    assert (found, said[: len(reason)]) == (status, reason)


@pytest.mark.parametrize(
    "sent",
    [b"\x00" * 100 + b"\r\n\r\n", b"GET /authority HTTP/1.1\r\n" + b"X: " + b"x" * MAX_BYTES * 3],
    ids=["no HTTP", "an endless header"],
)
async def test_what_is_no_http_ends_the_connection_alone(served: Serving, tmp_path: Path, sent: bytes) -> None:
    reader, writer = await served.connect_tls()
    writer.write(sent)
    assert await asyncio.wait_for(reader.read(), 60) == b""
    writer.close()
    await served.enrol(served.invite("r4"), tmp_path / "tls")


@pytest.mark.parametrize("tls", [False, True], ids=["in the handshake", "in a request"])
@pytest.mark.parametrize("drips", [False, True], ids=["silent", "a byte at a time"])
async def test_who_is_slow_is_left(
    served: Serving, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, tls: bool, drips: bool
) -> None:
    monkeypatch.setattr(enrolment_server, "CONNECTION_S", 0.5)
    reader, writer = await (served.connect_tls() if tls else served.connect())
    ended = asyncio.create_task(reader.read())
    writer.write(message(b"{", size=10_000) if tls else b"\x16\x03\x01\x40\x00")
    async with asyncio.timeout(60):
        while not ended.done():
            await asyncio.wait([ended], timeout=0.02 if drips else None)
            writer.write(b"\x01")
    with contextlib.suppress(ConnectionError):
        assert await ended == b""
    writer.close()
    monkeypatch.undo()
    await served.enrol(served.invite("r4"), tmp_path / "tls")


@pytest.mark.parametrize("limit", ["MAX_OF_ADDRESS", "MAX_CONNECTIONS"])
async def test_too_many_connections_are_closed(
    served: Serving, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, limit: str
) -> None:
    monkeypatch.setattr(enrolment_server, limit, 2)
    silent = [await served.connect() for _ in range(2)]
    reader, writer = await served.connect()
    assert await asyncio.wait_for(reader.read(), 60) == b""
    writer.close()
    assert "too many connections, closed one from 127.0.0.1" in caplog.text
    with pytest.raises(EnrolmentError, match="it closed the connection; try again"):
        await served.enrol(served.invite("r4"), tmp_path / "tls")
    caplog.set_level("INFO")
    for _, writer in silent:
        writer.close()
    await until(lambda: caplog.text.count("a connection from 127.0.0.1 failed") == 2)
    await served.enrol(served.invite("r4"), tmp_path / "tls")


async def test_the_server_s_own_certificate_is_made_anew(served: Serving, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(enrolment_server, "OWN_RENEWED_S", 0.01)
    seen = set[bytes]()
    async with serving(served.authority) as often:
        while len(seen) < 3:
            _, writer = await often.connect_tls()
            seen.add(writer.get_extra_info("ssl_object").getpeercert(binary_form=True))
            writer.close()


async def test_it_ends_while_somebody_is_connected(served: Serving) -> None:
    async with serving(served.authority) as ending:
        silent, talking = await ending.connect(), await ending.connect_tls()
        talking[1].write(message(b"{", size=100))
    for reader, writer in (silent, talking):
        assert await asyncio.wait_for(reader.read(), 5) == b""
        writer.close()


async def test_who_guesses_waits(served: Serving, tmp_path: Path) -> None:
    token = served.invite("r4")
    guess = message(asking(Token("r4", "guessed", ""), request("r4")))
    assert {(await refused(served, guess))[0] for _ in range(MAX_REFUSED)} == {403}
    assert (await refused(served, guess))[0] == 429
    with pytest.raises(EnrolmentError, match=r"too many refused attempts from 127\.0\.0\.1: wait for a minute"):
        await served.enrol(token, tmp_path / "tls")


def test_refused_attempts_are_forgotten() -> None:
    attempts = RefusedAttempts()
    for number in range(MAX_REFUSED):
        assert not attempts.too_many("10.0.0.1", number)
        attempts.add("10.0.0.1", number)
    assert attempts.too_many("10.0.0.1", REFUSED_S - 1)
    assert not attempts.too_many("10.0.0.2", REFUSED_S - 1)
    assert not attempts.too_many("10.0.0.1", REFUSED_S)
    attempts.add("10.0.0.1", REFUSED_S)
    assert not attempts.too_many("10.0.0.1", REFUSED_S)


def test_addresses_are_bounded() -> None:
    attempts = RefusedAttempts()
    for number in range(MAX_ADDRESSES + 1):
        for _ in range(MAX_REFUSED):
            attempts.add(f"address {number}", 0)
    assert not attempts.too_many("address 0", 1)
    assert attempts.too_many("address 1", 1)
