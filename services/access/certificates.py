"""Certificates as files and as they are signed: what the authority and the machines that it signs for share."""

import base64
import hashlib
import os
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.types import CertificatePublicKeyTypes
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

EARLIER: Final = timedelta(minutes=10)
"""Certificates are good from before they are made, for machines whose clocks are behind."""


def new_key() -> ec.EllipticCurvePrivateKey:
    """Return a new private key."""
    return ec.generate_private_key(ec.SECP256R1())


def fingerprint_of(certificate: x509.Certificate) -> str:
    """Return the SHA-256 of a certificate's public key, in URL-safe Base64. A renewed certificate has the same one."""
    digest = hashlib.sha256(public_bytes(certificate.public_key())).digest()
    return base64.urlsafe_b64encode(digest).decode().rstrip("=")


def public_bytes(key: CertificatePublicKeyTypes) -> bytes:
    """Return a public key as DER (SubjectPublicKeyInfo), by which keys are compared."""
    return key.public_bytes(serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo)


def common_name_of(names: x509.Name) -> str:
    """Return the common name, or an empty string."""
    found = names.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(found[0].value) if found else ""


def days_of(certificate: x509.Certificate) -> float:
    """Return the days for which a certificate was given."""
    return (certificate.not_valid_after_utc - certificate.not_valid_before_utc - EARLIER) / timedelta(days=1)


def sign_own(key: ec.EllipticCurvePrivateKey, days: float) -> bytes:
    """Return an authority's own certificate as PEM."""
    name = name_of("fleetsight authority")
    made = _builder(name, name, key.public_key(), key.public_key(), days)
    made = made.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    made = made.add_extension(_usage(signs_certificates=True), critical=True)
    return pem_of(made.sign(key, hashes.SHA256()))


def sign(
    name: str,
    key: ec.EllipticCurvePublicKey,
    hosts: Iterable[str],
    days: float,
    *,
    by: x509.Certificate,
    own: ec.EllipticCurvePrivateKey,
) -> bytes:
    """Return a certificate as PEM, for both ends of a link. by, own: the authority's certificate and private key."""
    made = _builder(name_of(name), by.subject, key, own.public_key(), days)
    both_ends = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    for extension, critical in (
        (x509.BasicConstraints(ca=False, path_length=None), True),
        (_usage(signs_certificates=False), True),
        (x509.ExtendedKeyUsage(both_ends), False),
        (x509.SubjectAlternativeName([_general_name(host) for host in hosts]), False),
    ):
        made = made.add_extension(extension, critical)
    return pem_of(made.sign(own, hashes.SHA256()))


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


def name_of(name: str) -> x509.Name:
    """Return a subject with this common name."""
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def hosts_of(certificate: x509.Certificate) -> tuple[str, ...]:
    """Return the names and addresses at which others connect to it."""
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return tuple(str(name.value) for name in names)


def pem_of(certificate: x509.Certificate) -> bytes:
    """Return a certificate as PEM."""
    return certificate.public_bytes(serialization.Encoding.PEM)


def pem_of_key(key: ec.EllipticCurvePrivateKey) -> bytes:
    """Return a private key as PEM, without a passphrase."""
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def write(file: Path, content: bytes, mode: int = 0o644) -> Path:
    """Write a file whole, or not at all: nobody else may ever read a key."""
    new = file.with_name(f".{file.name}")
    new.unlink(missing_ok=True)
    with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as opened:
        opened.write(content)
        opened.flush()
        os.fsync(opened.fileno())  # robots lose their power
    return new.replace(file)
