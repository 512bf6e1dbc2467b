"""Certificates of `fleetsight pki` and rules of `fleetsight access`, for processes in containers and elsewhere."""

import asyncio
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from services.access.process import run_access, run_pki
from services.access.settings import AccessSettings, PkiSettings

ROBOT: Final = "r1"
STRANGER: Final = "r2"
"""A robot whose certificate an authority of its own made. It knows the fleet's, which does not know it."""

USER: Final = 10001
"""The user of the containers."""


def make_certificates(folder: Path, roles: Mapping[str, str], *hosts: str) -> Path:
    """Make certificates for a robot and others, and access.json, in a folder; return the authority's folder in it.

    roles: by name. hosts: at which others connect to the monitor.
    """
    authority = folder / "pki"
    (folder / "fleet.yaml").write_text(json.dumps({"robots": [ROBOT], "roles": dict(roles)}), encoding="utf-8")
    asyncio.run(_make(folder, authority, roles, hosts))
    return authority


def make_central(folder: Path) -> None:
    """Make folders with what the processes of compose.robots.yaml need, and two robots, in a folder."""
    names = ("monitor", "detector", "space", "worldmodel")
    authority = make_certificates(folder, {name: name for name in names})
    for name in (*names, ROBOT):
        give(authority, name, folder / name)
    give_file(folder / "access.json", folder / "monitor")
    foreign = folder / "foreign"
    foreign.mkdir()
    other = make_certificates(foreign, {})
    shutil.copy(authority / "ca.pem", other)
    give(other, ROBOT, folder / STRANGER)


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


async def _make(folder: Path, authority: Path, roles: Mapping[str, str], hosts: Sequence[str]) -> None:
    await run_pki(PkiSettings(task="init", folder=authority))
    for name in (ROBOT, *roles):
        its_hosts = hosts if roles.get(name) == "monitor" else ()
        await run_pki(PkiSettings(task="issue", name=name, hosts=[*its_hosts], folder=authority))
    await run_access(AccessSettings(fleet=folder / "fleet.yaml", to=folder / "access.json", folder=authority))
