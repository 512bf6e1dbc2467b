"""Certificates of `fleetsight pki` for containers; values with which the chart takes them, and their secrets."""

import asyncio
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from services.access.process import run_access, run_pki
from services.access.settings import AccessSettings, PkiSettings
from tests.deploy.helm import NAME

ROBOT: Final = "r1"
USER: Final = 10001
"""The user of the containers."""

PASSWORD: Final = "of-the-database"  # noqa: S105 - of a database of this test alone
ROLES: Final = {"central": "monitor", "space1": "space", "world1": "worldmodel"}
VALUES: Final[Mapping[str, Any]] = {
    "image": {"tag": "latest"},
    "tls": {"monitor": "central", "space": "space1", "worldmodel": "world1", "access": "access"},
    "monitor": {"history": {"secret": "history"}},
    "detector": {"enabled": False},
    "cloud": {"enabled": False},
}


def make_certificates(folder: Path, roles: Mapping[str, str], *hosts: str) -> Path:
    """Make certificates for a robot and others, and access.json, in a folder; return the authority's folder in it.

    roles: by name. hosts: at which others connect to the monitor.
    """
    authority = folder / "pki"
    (folder / "fleet.yaml").write_text(json.dumps({"robots": [ROBOT], "roles": dict(roles)}), encoding="utf-8")
    asyncio.run(_make(folder, authority, roles, hosts))
    return authority


def give(authority: Path, name: str, folder: Path) -> None:
    """Make a folder with what the process of a certificate needs, for the user of the containers."""
    folder.mkdir()
    os.chown(folder, USER, USER)
    for file in ("ca.pem", f"{name}.pem", f"{name}.key"):
        give_file(authority / file, folder)


def give_file(file: Path, folder: Path) -> None:
    """Copy a file into a folder of the user of the containers."""
    copied = folder / file.name
    copied.write_bytes(file.read_bytes())
    copied.chmod(0o400)
    os.chown(copied, USER, USER)


def make_secrets(folder: Path) -> list[dict[str, Any]]:
    """Make an authority and certificates in a folder; return the Secrets and the ConfigMap that VALUES name."""
    authority = make_certificates(folder, ROLES, f"{NAME}-monitor")
    give(authority, ROBOT, folder / "robot")
    url = f"postgresql://fleetsight:{PASSWORD}@database/postgres"
    return [
        _object("ConfigMap", "access", data={"access.json": (folder / "access.json").read_text(encoding="utf-8")}),
        _object("Secret", "history", stringData={"url": url}),
        *(_certificate(authority, name) for name in ROLES),
    ]


async def _make(folder: Path, authority: Path, roles: Mapping[str, str], hosts: Sequence[str]) -> None:
    await run_pki(PkiSettings(task="init", folder=authority))
    for name in (ROBOT, *roles):
        its_hosts = hosts if roles.get(name) == "monitor" else ()
        await run_pki(PkiSettings(task="issue", name=name, hosts=[*its_hosts], folder=authority))
    await run_access(AccessSettings(fleet=folder / "fleet.yaml", to=folder / "access.json", folder=authority))


def _certificate(authority: Path, name: str) -> dict[str, Any]:
    files = {"ca.crt": "ca.pem", "tls.crt": f"{name}.pem", "tls.key": f"{name}.key"}
    data = {key: (authority / file).read_text(encoding="utf-8") for key, file in files.items()}
    return _object("Secret", name, type="kubernetes.io/tls", stringData=data)


def _object(kind: str, name: str, **more: object) -> dict[str, Any]:
    return {"apiVersion": "v1", "kind": kind, "metadata": {"name": name}, **more}
