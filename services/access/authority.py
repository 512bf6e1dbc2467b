"""A fleet's certificate authority: a folder with its key, and a certificate and a key for each name."""

import fcntl
import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from services.access.certificates import (
    common_name_of,
    days_of,
    fingerprint_of,
    hosts_of,
    new_key,
    pem_of_key,
    public_bytes,
    sign,
    sign_own,
    write,
)
from services.access.enrolment_protocol import SERVER_NAME

AUTHORITY: Final = "ca"
"""Name of the authority's own files."""

AUTHORITY_DAYS: Final = 3_650
HERE: Final = ("localhost", "127.0.0.1")
"""Programs on the same machine, such as the doctor, connect to these."""

REVOKED: Final = "revoked"


class AuthorityError(Exception):
    """It cannot be done; the message says why, and what helps."""


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate. days: for which it was given. hosts: names and addresses at which others connect to it."""

    name: str
    until: datetime
    days: float
    hosts: tuple[str, ...]
    revoked: bool = False


class Authority:
    """The authority whose files are in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def make(self) -> Path:
        """Make the authority; return its certificate.

        Raises:
            AuthorityError: there is one already.
        """
        if self._key(AUTHORITY).exists():
            raise AuthorityError(f"{self._key(AUTHORITY)} is there: a second authority would not know its certificates")
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        key = new_key()
        write(self._key(AUTHORITY), pem_of_key(key), mode=0o600)
        return self._sign_itself(key)

    def issue(self, name: str, hosts: Sequence[str], days: float) -> Path:
        """Make a certificate and its key; return the certificate's file.

        Raises:
            AuthorityError: there is one of this name, or was one that is revoked and has not ended.
        """
        with locked(self.folder):
            self.check_free(name, hosts)
            key = new_key()
            signed = self._sign(name, key.public_key(), hosts, days)
            write(self._key(name), pem_of_key(key), mode=0o600)
            return write(self._certificate(name), signed)

    def admit(
        self, name: str, key: ec.EllipticCurvePublicKey, hosts: Sequence[str], days: float, *, replace: bool
    ) -> bytes:
        """Make a certificate for a machine that has a key of its own, and return it as PEM.

        replace: also where there is one of this name; a key of it that is in the folder is deleted.

        Raises:
            AuthorityError: there is one of this name, or was one that is revoked and has not ended.
        """
        with locked(self.folder):
            self.check_free(name, hosts, replace=replace)
            signed = self._sign(name, key, hosts, days)
            write(self._certificate(name), signed)
            self._key(name).unlink(missing_ok=True)
            return signed

    def check_free(self, name: str, hosts: Sequence[str] = (), *, replace: bool = False) -> None:
        """Check that a name and hosts may be given; replace: also where there is a certificate of this name.

        Raises:
            AuthorityError: they may not.
        """
        if name == AUTHORITY:
            raise AuthorityError(f"{AUTHORITY} is the authority's own name; give another one")
        if taken := [host for host in (name, *hosts) if host.rstrip(".").lower() == SERVER_NAME]:
            raise AuthorityError(f"{taken[0]} is the name of `fleetsight pki serve`; give another one")
        if self._certificate(name).exists() and not replace:
            raise AuthorityError(f"there is a certificate of {name}: renew it, or revoke it and choose another name")
        if (gone := self._revoked(name)) is not None and gone.until > datetime.now(UTC):
            raise AuthorityError(
                f"{name} is revoked, and that certificate is good until {gone.until:%Y-%m-%d}: choose another name"
            )

    def renew(self, name: str, days: float) -> Path:
        """Make a certificate anew, with the same key and for the same hosts; return its file. Also the authority's.

        Raises:
            AuthorityError: there is none of this name.
        """
        with locked(self.folder):
            if name == AUTHORITY:
                return self._sign_itself(self._private_key())
            old = _read(self._certificate(name))
            return write(self._certificate(name), self._signed_again(name, old, days))

    def renew_own(self, presented: x509.Certificate) -> tuple[str, bytes]:
        """Renew the certificate that a machine connects with; return its name, and as PEM a new one.

        It is for as many days, or as many as the newest of its name if those are fewer.

        Raises:
            AuthorityError: it is revoked, forgotten, or has another key than the newest of its name.
        """
        name = common_name_of(presented.subject)
        cure = f"`fleetsight pki invite {name} --replace` at the authority lets this one enrol again"
        with locked(self.folder):
            if not self._certificate(name).exists() or name == AUTHORITY:
                if self._revoked_file(name).exists():
                    raise AuthorityError(f"{name} is revoked: this machine needs an invitation under another name")
                raise AuthorityError(f"the authority has no certificate of {name}: {cure}")
            newest = _read(self._certificate(name))
            if public_bytes(newest.public_key()) != public_bytes(presented.public_key()):
                raise AuthorityError(f"another machine has enrolled as {name} since: {cure}")
            signed = self._signed_again(name, newest, min(days_of(presented), days_of(newest)))
            write(self._certificate(name), signed)
            return name, signed

    def _signed_again(self, name: str, old: x509.Certificate, days: float) -> bytes:
        key = old.public_key()
        if not isinstance(key, ec.EllipticCurvePublicKey):
            raise AuthorityError(f"{self._certificate(name)}: this is none that `fleetsight pki issue` makes")
        return self._sign(name, key, hosts_of(old), days)

    def revoke(self, name: str) -> Issued:
        """Delete a key, and remember its certificate as revoked.

        Raises:
            AuthorityError: there is none of this name.
        """
        with locked(self.folder):
            issued = _issued(name, _read(self._certificate(name)), revoked=True)
            self._revoked_file(name).parent.mkdir(exist_ok=True, mode=0o700)
            self._certificate(name).replace(self._revoked_file(name))
            self._key(name).unlink(missing_ok=True)
            return issued

    def all(self) -> Iterator[Issued]:
        """Yield the certificates, the authority's first, revoked ones last.

        Raises:
            AuthorityError: there is no authority in the folder.
        """
        yield _issued(AUTHORITY, _read(self._certificate(AUTHORITY)))
        for file in sorted(self.folder.glob("*.pem")):
            if file.stem != AUTHORITY:
                yield _issued(file.stem, _read(file))
        for file in sorted((self.folder / REVOKED).glob("*.pem")):
            yield _issued(file.stem, _read(file), revoked=True)

    def certificate(self) -> x509.Certificate:
        """Return the authority's certificate.

        Raises:
            AuthorityError: there is no authority in the folder.
        """
        return _read(self._certificate(AUTHORITY))

    def fingerprint(self) -> str:
        """Return what tells this authority from any other, for tokens."""
        return fingerprint_of(self.certificate())

    def certificate_of_server(self, days: float) -> tuple[bytes, bytes]:
        """Return a certificate and a key as PEM, which are nowhere else, for SERVER_NAME, which no other one has."""
        key, own = new_key(), self._private_key()
        signed = sign(SERVER_NAME, key.public_key(), [SERVER_NAME], days, by=self.certificate(), own=own)
        return signed, pem_of_key(key)

    def _sign_itself(self, key: ec.EllipticCurvePrivateKey) -> Path:
        return write(self._certificate(AUTHORITY), sign_own(key, AUTHORITY_DAYS))

    def _sign(self, name: str, key: ec.EllipticCurvePublicKey, hosts: Sequence[str], days: float) -> bytes:
        known = tuple(dict.fromkeys((name, *HERE, *hosts)))
        return sign(name, key, known, days, by=self.certificate(), own=self._private_key())

    def _private_key(self) -> ec.EllipticCurvePrivateKey:
        file = self._key(AUTHORITY)
        try:
            key = serialization.load_pem_private_key(file.read_bytes(), None)
        except FileNotFoundError:
            raise AuthorityError(f"there is no authority in {self.folder}: `fleetsight pki init` makes one") from None
        except (ValueError, TypeError) as error:
            raise AuthorityError(f"{file}: no private key of an authority can be read from it") from error
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise AuthorityError(f"{file}: this is no key that `fleetsight pki init` makes")
        if file.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise AuthorityError(f"{file}: others than its owner may use the authority's key; run chmod go= {file}")
        return key

    def _certificate(self, name: str) -> Path:
        return self.folder / f"{name}.pem"

    def _key(self, name: str) -> Path:
        return self.folder / f"{name}.key"

    def _revoked_file(self, name: str) -> Path:
        return self.folder / REVOKED / f"{name}.pem"

    def _revoked(self, name: str) -> Issued | None:
        file = self._revoked_file(name)
        return _issued(name, _read(file), revoked=True) if file.exists() else None


def _issued(name: str, certificate: x509.Certificate, *, revoked: bool = False) -> Issued:
    hosts = hosts_of(certificate) if name != AUTHORITY else ()
    return Issued(name, certificate.not_valid_after_utc, days_of(certificate), hosts, revoked)


def _read(file: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(file.read_bytes())
    except FileNotFoundError:
        if file.stem == AUTHORITY:
            raise AuthorityError(f"there is no authority in {file.parent}: `fleetsight pki init` makes one") from None
        raise AuthorityError(f"there is no certificate of {file.stem} in {file.parent}") from None
    except ValueError as error:
        raise AuthorityError(f"{file}: no certificate can be read from it") from error


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Let nobody else change a folder's certificates and invitations meanwhile, in this process or another.

    Raises:
        AuthorityError: there is no such folder.
    """
    try:
        opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except FileNotFoundError:
        raise AuthorityError(f"there is no authority in {folder}: `fleetsight pki init` makes one") from None
    try:
        fcntl.flock(opened, fcntl.LOCK_EX)
        yield
    finally:
        os.close(opened)
