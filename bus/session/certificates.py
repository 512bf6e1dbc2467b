"""Checks certificate files before connecting: Zenoh does not report why a TLS link fails."""

import ssl
import stat
from pathlib import Path
from typing import Final, NoReturn

from bus.errors import BusError
from bus.settings import BusSettings

_MISMATCHES: Final = ("KEY_VALUES_MISMATCH", "KEY_TYPE_MISMATCH", "NO_CERTIFICATE_ASSIGNED")
"""OpenSSL's reason when a private key does not belong to a certificate."""


class _PassphraseError(Exception):
    pass


def check_certificates(settings: BusSettings) -> None:
    """Check that the certificate files given are usable.

    Raises:
        BusError: one cannot; the message names its setting.
    """
    if settings.tls_ca is None or settings.tls_certificate is None or settings.tls_key is None:
        return
    _check_certificate("tls_ca", settings.tls_ca)
    check_pair("tls_certificate", settings.tls_certificate, "tls_key", settings.tls_key)


def check_pair(certificate_setting: str, certificate: Path, key_setting: str, key: Path) -> None:
    """Check that a certificate and its private key are usable, and that not everybody may read the key.

    Raises:
        BusError: they are not; the message names the setting.
    """
    _check_certificate(certificate_setting, certificate)
    _check_key(f"{key_setting} {key}", key, f"{certificate_setting} {certificate}", certificate)
    _check_private(key_setting, key)


def _check_certificate(setting: str, file: Path) -> None:
    try:
        _context().load_verify_locations(file)
    except ssl.SSLError as error:
        raise BusError(f"{setting} {file}: no PEM certificate can be read from it") from error
    except OSError as error:
        raise BusError(f"{setting} {file}: {error.strerror or error}") from error


def _check_key(said: str, file: Path, certificate_said: str, certificate: Path) -> None:
    try:
        with file.open("rb"):  # OpenSSL does not say which of the two files it cannot open
            _context().load_cert_chain(certificate, file, password=_refuse_to_ask)
    except _PassphraseError as error:
        raise BusError(f"{said}: it has a passphrase, which is not supported; give a key without one") from error
    except ssl.SSLError as error:
        if error.reason in _MISMATCHES:
            raise BusError(f"{said}: does not belong to {certificate_said}") from error
        if not error.reason or error.library == "PEM":
            raise BusError(f"{said}: no PEM private key can be read from it") from error
        reason = error.reason.lower().replace("_", " ")
        raise BusError(f"{said}, {certificate_said}: {reason}") from error
    except OSError as error:
        raise BusError(f"{said}: {error.strerror or error}") from error


def _check_private(setting: str, file: Path) -> None:
    """A group may read a key: containers and systemd give it to a process that way."""
    if file.stat().st_mode & (stat.S_IROTH | stat.S_IWOTH):
        raise BusError(f"{setting} {file}: everybody on this machine may read it; run chmod o= {file}")


def _context() -> ssl.SSLContext:
    return ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)


def _refuse_to_ask() -> NoReturn:
    raise _PassphraseError
