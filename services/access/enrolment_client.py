"""`fleetsight pki enrol`: gets a certificate for a key that is made here and goes nowhere, and renews it."""

import http.client
import ssl
import stat
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Final, TypeVar

import msgspec
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization

from services.access import enrolment_protocol as protocol
from services.access.certificates import (
    EARLIER,
    common_name_of,
    fingerprint_of,
    name_of,
    new_key,
    pem_of,
    pem_of_key,
    public_bytes,
    write,
)

ANSWER_S: Final = 15.0
LAST_PART: Final = 1 / 3
"""A certificate is renewed in the last third of its time: links are opened anew when it changes."""

T = TypeVar("T", bound=msgspec.Struct)


class EnrolmentError(Exception):
    """It cannot be done; the message says why, and what helps."""


class Files:
    """A machine's certificate files in a folder, named as `--tls FOLDER/NAME` expects them."""

    def __init__(self, folder: Path, name: str) -> None:
        self.authority = folder / "ca.pem"
        self.certificate = folder / f"{name}.pem"
        self.key = folder / f"{name}.key"
        self.short = folder / name


def enrol(token: protocol.Token, address: tuple[str, int], files: Files) -> x509.Certificate:
    """Make a key, have it certified, and write the files; return the certificate.

    Raises:
        EnrolmentError: there are such files, the server is none of the token's authority, or it refuses.
        OSError: a file cannot be written.
    """
    _check_new(token, files)
    files.key.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    key = new_key()
    pending = write(files.key.with_name(f"{files.key.name}.new"), pem_of_key(key), mode=0o600)
    try:
        request = x509.CertificateSigningRequestBuilder().subject_name(name_of(token.name)).sign(key, hashes.SHA256())
        text = request.public_bytes(serialization.Encoding.PEM).decode()
        asked = protocol.EnrolRequest(token.name, token.secret, text)
        trusted = _authority_of(token, address)
        answer = _ask(address, _verified(trusted), protocol.ENROL_PATH, protocol.Enrolled, asked)
        made, known = _checked(answer, token.name, public_bytes(key.public_key()), token.authority)
        write(files.authority, pem_of(known))
        pending.replace(files.key)
        write(files.certificate, pem_of(made))
    finally:
        pending.unlink(missing_ok=True)
    return made


def renew(name: str, address: tuple[str, int], files: Files, *, now: datetime) -> x509.Certificate | None:
    """Have a certificate renewed, for the same key; return it, or None while it is good for long.

    Raises:
        EnrolmentError: it has ended or is unusable, the server is another authority's, or it refuses.
        OSError: a file cannot be written.
    """
    old, authority = _read(files.certificate), _read(files.authority)
    if old.not_valid_after_utc <= now:
        raise EnrolmentError(
            f"{files.certificate} ended at {old.not_valid_after_utc:%Y-%m-%d %H:%M} UTC: move it and its key away and "
            f"enrol with the token that `fleetsight pki invite {name} --replace` at the authority prints"
        )
    try:
        old.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise EnrolmentError(f"{files.certificate} is not of the authority of {files.authority}") from error
    whole = old.not_valid_after_utc - old.not_valid_before_utc - EARLIER
    if old.not_valid_after_utc - now > whole * LAST_PART:
        return None
    tls = _verified(files.authority.read_text(encoding="utf-8"))
    try:
        with files.key.open("rb"):  # OpenSSL does not say which of the two files it cannot open
            tls.load_cert_chain(files.certificate, files.key)
    except ssl.SSLError as error:
        raise EnrolmentError(f"{files.key}: no key of {files.certificate} can be read from it") from error
    if files.key.stat().st_mode & stat.S_IRWXO:
        raise EnrolmentError(f"{files.key}: everybody on this machine may use it; run chmod o= {files.key}")
    answer = _ask(address, tls, protocol.RENEW_PATH, protocol.Enrolled)
    made, known = _checked(answer, name, public_bytes(old.public_key()), fingerprint_of(authority))
    if pem_of(known) != files.authority.read_bytes():
        write(files.authority, pem_of(known))
    write(files.certificate, pem_of(made))
    return made


def _check_new(token: protocol.Token, files: Files) -> None:
    for file in (files.certificate, files.key):
        if file.exists():
            raise EnrolmentError(f"{file} is there: renew it with --renew, move it away, or give another --into")
    if files.authority.exists() and fingerprint_of(_read(files.authority)) != token.authority:
        raise EnrolmentError(f"{files.authority} is another authority's than the token's: give another --into")


def _authority_of(token: protocol.Token, address: tuple[str, int]) -> str:
    """Return the authority's certificate, as PEM, from a server that is not trusted yet."""
    unverified = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    unverified.check_hostname = False
    unverified.verify_mode = ssl.CERT_NONE
    answer = _ask(address, unverified, protocol.AUTHORITY_PATH, protocol.Authority)
    try:
        found = x509.load_pem_x509_certificate(answer.authority.encode())
    except ValueError as error:
        raise EnrolmentError(
            f"{_shown(address)} answers with no certificate: it is no `fleetsight pki serve`"
        ) from error
    if fingerprint_of(found) != token.authority:
        raise EnrolmentError(
            f"{_shown(address)} is another authority than the token's. Somebody may be in between, and nothing was "
            "sent; check --at, and that the token is whole"
        )
    return pem_of(found).decode()  # nothing else that came with it, such as another authority's


def _verified(authority: str) -> ssl.SSLContext:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    tls.load_verify_locations(cadata=authority)
    return tls


class _Connection(http.client.HTTPConnection):
    """HTTPS to a server whose certificate has SERVER_NAME, wherever it is."""

    def __init__(self, address: tuple[str, int], tls: ssl.SSLContext) -> None:
        super().__init__(*address, timeout=ANSWER_S)
        self._tls = tls

    def connect(self) -> None:
        super().connect()
        self.sock = self._tls.wrap_socket(self.sock, server_hostname=protocol.SERVER_NAME)


def _ask(
    address: tuple[str, int], tls: ssl.SSLContext, path: str, kind: type[T], asked: msgspec.Struct | None = None
) -> T:
    """Return a server's answer.

    Raises:
        EnrolmentError: none came, or a refusal.
    """
    tls.minimum_version = ssl.TLSVersion.TLSv1_3
    connection = _Connection(address, tls)
    try:
        body = b"" if asked is None else msgspec.json.encode(asked)
        connection.request("GET" if path == protocol.AUTHORITY_PATH else "POST", path, body)
        response = connection.getresponse()
        content = response.read(protocol.MAX_BYTES)
    except ssl.SSLCertVerificationError as error:
        raise EnrolmentError(
            f"{_shown(address)}: its certificate is not accepted: {error.verify_message}; check --at, "
            "and this machine's clock"
        ) from error
    except (ssl.SSLEOFError, ConnectionResetError) as error:
        raise EnrolmentError(
            f"{_shown(address)}: it closed the connection; try again, and check the clocks of both machines"
        ) from error
    except ssl.SSLError as error:
        reason = (error.reason or str(error)).lower().replace("_", " ")
        raise EnrolmentError(f"{_shown(address)}: TLS failed: {reason}; is `fleetsight pki serve` there?") from error
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise EnrolmentError(f"{_shown(address)}: {reason}; is `fleetsight pki serve` running there?") from error
    finally:
        connection.close()
    try:
        if response.status == http.client.OK:
            return msgspec.json.decode(content, type=kind)
        refusal = msgspec.json.decode(content, type=protocol.Refusal)
    except msgspec.DecodeError as error:
        raise EnrolmentError(f"{_shown(address)}: its answer is no `fleetsight pki serve`'s; check --at") from error
    raise EnrolmentError(f"{_shown(address)} refuses: {refusal.error}")


def _checked(
    answer: protocol.Enrolled, name: str, key: bytes, authority: str
) -> tuple[x509.Certificate, x509.Certificate]:
    """Return the certificate of an answer, if it is what was asked for, and its authority's."""
    try:
        made = x509.load_pem_x509_certificate(answer.certificate.encode())
        known = x509.load_pem_x509_certificate(answer.authority.encode())
        made.verify_directly_issued_by(known)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise EnrolmentError(
            "the answer holds no certificate of its authority; run the same version at both ends"
        ) from error
    right = common_name_of(made.subject) == name and public_bytes(made.public_key()) == key
    if not right or fingerprint_of(known) != authority:
        raise EnrolmentError(f"the certificate that came is not for {name} and its key; nothing was written")
    return made, known


def _read(file: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(file.read_bytes())
    except FileNotFoundError:
        raise EnrolmentError(f"{file} is not there: enrol with a token first, or give another --into") from None
    except ValueError as error:
        raise EnrolmentError(f"{file}: no certificate can be read from it") from error


def _shown(address: tuple[str, int]) -> str:
    host, port = address
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def lines_of_enrolment(files: Files, made: x509.Certificate, at: str) -> Iterator[str]:
    """Yield what somebody needs to know who has enrolled a machine."""
    name = common_name_of(made.subject)
    short = files.short.absolute()
    yield f"{files.authority}, {files.certificate}, {files.key}: for {name}, until {made.not_valid_after_utc:%Y-%m-%d}"
    yield f"in gateway.yaml or another file of settings: tls: {short}"
    yield f"on a command line: --tls {short}"
    yield f"renew it once a day: fleetsight pki enrol {name} --renew --at {at} --into {files.key.parent.absolute()}"
