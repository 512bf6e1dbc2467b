"""The chart with certificates and a PostgreSQL: values, and the secrets that they name, made by `fleetsight pki`."""

import asyncio
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from services.access.process import run_access, run_pki
from services.access.settings import AccessSettings, PkiSettings
from tests.deploy.helm import NAME

ROBOT: Final = "r1"
USER: Final = 10001
"""The user of the containers."""

PASSWORD: Final = "of-the-database"  # noqa: S105 - of a database of this test alone
FLEET: Final = f"robots: [{ROBOT}]\nroles: {{central: monitor, space1: space, world1: worldmodel}}\n"
VALUES: Final[Mapping[str, Any]] = {
    "image": {"tag": "latest"},
    "tls": {"monitor": "central", "space": "space1", "worldmodel": "world1", "access": "access"},
    "monitor": {"history": {"secret": "history"}},
    "detector": {"enabled": False},
    "cloud": {"enabled": False},
}


def make_secrets(folder: Path) -> list[dict[str, Any]]:
    """Make an authority and certificates in a folder; return the Secrets and the ConfigMap that VALUES name."""
    authority = folder / "pki"
    asyncio.run(_make(folder, authority))
    for file in (authority / f"{ROBOT}.pem", authority / f"{ROBOT}.key", authority / "ca.pem"):
        (folder / "robot").mkdir(exist_ok=True)
        copied = folder / "robot" / file.name
        copied.write_bytes(file.read_bytes())
        copied.chmod(0o400)
        _give(copied)
    _give(folder / "robot")
    url = f"postgresql://fleetsight:{PASSWORD}@database/postgres"
    return [
        _object("ConfigMap", "access", data={"access.json": (folder / "access.json").read_text(encoding="utf-8")}),
        _object("Secret", "history", stringData={"url": url}),
        *(_certificate(authority, name) for name in ("central", "space1", "world1")),
    ]


async def _make(folder: Path, authority: Path) -> None:
    await run_pki(PkiSettings(task="init", folder=authority))
    for name in ("space1", "world1", ROBOT):
        await run_pki(PkiSettings(task="issue", name=name, folder=authority))
    await run_pki(PkiSettings(task="issue", name="central", hosts=[f"{NAME}-monitor"], folder=authority))
    (folder / "fleet.yaml").write_text(FLEET, encoding="utf-8")
    await run_access(AccessSettings(fleet=folder / "fleet.yaml", to=folder / "access.json", folder=authority))


def _certificate(authority: Path, name: str) -> dict[str, Any]:
    files = {"ca.crt": "ca.pem", "tls.crt": f"{name}.pem", "tls.key": f"{name}.key"}
    data = {key: (authority / file).read_text(encoding="utf-8") for key, file in files.items()}
    return _object("Secret", name, type="kubernetes.io/tls", stringData=data)


def _object(kind: str, name: str, **more: object) -> dict[str, Any]:
    return {"apiVersion": "v1", "kind": kind, "metadata": {"name": name}, **more}


def _give(path: Path) -> None:
    os.chown(path, USER, USER)
