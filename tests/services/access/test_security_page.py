"""The recipe of the page on security."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

from services.access.roles import Role

PAGE = Path(__file__).parents[3] / "docs/security.md"


def test_its_commands_make_certificates_and_rules(tmp_path: Path) -> None:
    block = re.search(r"```sh\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert block is not None
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    subprocess.run(["bash", "-euc", block[1]], cwd=tmp_path, check=True, env={**os.environ, "PATH": path})
    made = {file.name for file in (tmp_path / "pki").iterdir()}
    assert made == {f"{name}.{kind}" for name in ("ca", "central", "gpu1", "r1", "ann") for kind in ("pem", "key")}
    rules = json.loads((tmp_path / "access.json").read_text(encoding="utf-8"))
    assert len(rules["subjects"]) == 203


def test_it_has_every_role() -> None:
    told = re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert told == list(Role)
