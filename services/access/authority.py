"""A fleet's certificate authority: a folder with its key, and a certificate and a key for each name."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

AUTHORITY: Final = "ca"
"""Name of the authority's own files."""

AUTHORITY_DAYS: Final = 3_650
EARLIER: Final = timedelta(minutes=10)
"""Certificates are good from before they are made, for machines whose clocks are behind."""

HERE: Final = ("localhost", "127.0.0.1")
"""What runs on a machine itself, such as the doctor, connects to these."""

REVOKED: Final = "revoked"


class AuthorityError(Exception):
    """It cannot be done; the message says why, and what helps."""


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate. hosts: names and addresses at which others connect to it."""

    name: str
    until: datetime
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
        key = ec.generate_private_key(ec.SECP256R1())
        _write(self._key(AUTHORITY), _pem_of_key(key), mode=0o600)
        return self._sign_itself(key)

    def issue(self, name: str, hosts: Sequence[str], days: float) -> Path:
        """Make a certificate and its key; return the certificate's file.

        Raises:
            AuthorityError: there is one of this name, or was one that is revoked and has not ended.
        """
        if name == AUTHORITY:
            raise AuthorityError(f"{AUTHORITY} is the authority's own name; give another one")
        if self._certificate(name).exists():
            raise AuthorityError(f"there is a certificate of {name}: renew it, or revoke it and choose another name")
        if (gone := self._revoked(name)) is not None and gone.until > datetime.now(UTC):
            raise AuthorityError(
                f"{name} is revoked, and that certificate is good until {gone.until:%Y-%m-%d}: choose another name"
            )
        key = ec.generate_private_key(ec.SECP256R1())
        signed = self._sign(name, key.public_key(), tuple(dict.fromkeys((name, *HERE, *hosts))), days)
        _write(self._key(name), _pem_of_key(key), mode=0o600)
        return _write(self._certificate(name), signed)

    def renew(self, name: str, days: float) -> Path:
        """Make a certificate anew, with the same key and for the same hosts; return its file. Also the authority's.

        Raises:
            AuthorityError: there is none of this name.
        """
        if name == AUTHORITY:
            return self._sign_itself(self._private_key())
        old = _read(self._certificate(name))
        key = old.public_key()
        if not isinstance(key, ec.EllipticCurvePublicKey):
            raise AuthorityError(f"{self._certificate(name)}: this is none that `fleetsight pki issue` makes")
        signed = self._sign(name, key, _hosts_of(old), days)
        return _write(self._certificate(name), signed)

    def revoke(self, name: str) -> Issued:
        """Delete a key, and remember its certificate as revoked.

        Raises:
            AuthorityError: there is none of this name.
        """
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

    def _sign_itself(self, key: ec.EllipticCurvePrivateKey) -> Path:
        name = _name_of("fleetsight authority")
        builder = _builder(name, name, key.public_key(), key.public_key(), AUTHORITY_DAYS)
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        builder = builder.add_extension(_usage(signs_certificates=True), critical=True)
        return _write(self._certificate(AUTHORITY), _pem_of(builder.sign(key, hashes.SHA256())))

    def _sign(self, name: str, key: ec.EllipticCurvePublicKey, hosts: Iterable[str], days: float) -> bytes:
        authority, own = _read(self._certificate(AUTHORITY)), self._private_key()
        builder = _builder(_name_of(name), authority.subject, key, own.public_key(), days)
        both_ends = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        for extension, critical in (
            (x509.BasicConstraints(ca=False, path_length=None), True),
            (_usage(signs_certificates=False), True),
            (x509.ExtendedKeyUsage(both_ends), False),
            (x509.SubjectAlternativeName([_general_name(host) for host in hosts]), False),
        ):
            builder = builder.add_extension(extension, critical)
        return _pem_of(builder.sign(own, hashes.SHA256()))

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


def _builder(
    name: x509.Name, by: x509.Name, key: ec.EllipticCurvePublicKey, signer: ec.EllipticCurvePublicKey, days: float
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(by)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signer), critical=False)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _name_of(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _hosts_of(certificate: x509.Certificate) -> tuple[str, ...]:
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return tuple(str(name.value) for name in names)


def _issued(name: str, certificate: x509.Certificate, *, revoked: bool = False) -> Issued:
    hosts = _hosts_of(certificate) if name != AUTHORITY else ()
    return Issued(name, certificate.not_valid_after_utc, hosts, revoked)


def _read(file: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(file.read_bytes())
    except FileNotFoundError:
        if file.stem == AUTHORITY:
            raise AuthorityError(f"there is no authority in {file.parent}: `fleetsight pki init` makes one") from None
        raise AuthorityError(f"there is no certificate of {file.stem} in {file.parent}") from None
    except ValueError as error:
        raise AuthorityError(f"{file}: no certificate can be read from it") from error


def _pem_of(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _pem_of_key(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _write(file: Path, content: bytes, mode: int = 0o644) -> Path:
    """Write a file whole, or not at all: nobody else may ever read a key."""
    new = file.with_name(f".{file.name}")
    new.unlink(missing_ok=True)
    with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as opened:
        opened.write(content)
    return new.replace(file)
