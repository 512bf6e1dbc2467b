"""The chart with certificates and a PostgreSQL: values, and the secrets that they name."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from tests.deploy.support.certificates import ROBOT, give, make_certificates
from tests.deploy.support.helm import NAME

PASSWORD: Final = "of-the-database"  # noqa: S105 - of a database of this test alone
ROLES: Final = {"central": "monitor", "space1": "space", "world1": "worldmodel"}
VALUES: Final[Mapping[str, Any]] = {
    "image": {"tag": "latest"},
    "tls": {"monitor": "central", "space": "space1", "worldmodel": "world1", "access": "access"},
    "monitor": {"history": {"secret": "history"}},
    "detector": {"enabled": False},
    "cloud": {"enabled": False},
}


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


def _certificate(authority: Path, name: str) -> dict[str, Any]:
    files = {"ca.crt": "ca.pem", "tls.crt": f"{name}.pem", "tls.key": f"{name}.key"}
    data = {key: (authority / file).read_text(encoding="utf-8") for key, file in files.items()}
    return _object("Secret", name, type="kubernetes.io/tls", stringData=data)


def _object(kind: str, name: str, **more: object) -> dict[str, Any]:
    return {"apiVersion": "v1", "kind": kind, "metadata": {"name": name}, **more}
