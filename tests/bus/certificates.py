"""Certificates of a fleet, made as `fleetsight pki` makes them."""

from pathlib import Path
from typing import Final

from services.access.authority import Authority

HOSTS: Final = ("central", "gpu1", "r1", "r2")


def make_certificates(folder: Path) -> None:
    """Make an authority and certificates for some hosts, or renew those in a folder."""
    authority = Authority(folder)
    if (folder / "ca.pem").exists():
        for name in ("ca", *HOSTS):
            authority.renew(name, 90)
        return
    authority.make()
    for name in HOSTS:
        authority.issue(name, (), 90)


def certificate(folder: Path, host: str) -> dict[str, Path]:
    """Return the settings of a process on one of these hosts."""
    return {"tls_ca": folder / "ca.pem", "tls_certificate": folder / f"{host}.pem", "tls_key": folder / f"{host}.key"}
