"""Certificates made as the documentation says."""

import re
import subprocess
from pathlib import Path

from tests.bus.sessions import ROOT


def make_certificates(folder: Path) -> None:
    """Make an authority and certificates for the hosts that the documentation names, or renew those in a folder."""
    block = re.search(r"```sh\n(.*?)```", (ROOT / "docs/security.md").read_text(), re.DOTALL)
    assert block is not None
    folder.mkdir(exist_ok=True)
    subprocess.run(["bash", "-euc", block[1]], cwd=folder, check=True, capture_output=True)


def certificate(folder: Path, host: str) -> dict[str, Path]:
    """Return the settings of a process on one of these hosts."""
    return {"tls_ca": folder / "ca.pem", "tls_certificate": folder / f"{host}.pem", "tls_key": folder / f"{host}.key"}
