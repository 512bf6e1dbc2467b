"""The recipes of the page on security and of the README."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

from services.access.roles import Role

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs/security.md"


def run(commands: str, folder: Path) -> None:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    subprocess.run(["bash", "-euc", commands], cwd=folder, check=True, env={**os.environ, "PATH": path})


def test_the_readmes_commands_let_each_do_what_it_is_for(tmp_path: Path) -> None:
    lines = [line.strip() for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines()]
    first = next(number for number, line in enumerate(lines) if line.endswith(">fleet.yaml   # names and their roles"))
    after = next(number for number, line in enumerate(lines) if line.startswith("fleetsight monitor --listen tls/"))
    run("\n".join(lines[first:after]), tmp_path)
    rules = json.loads((tmp_path / "access.json").read_text(encoding="utf-8"))
    assert {subject["id"] for subject in rules["subjects"]} == {"r1", "central", "gpu1"}
    assert {file.stem for file in (tmp_path / "pki").glob("*.key")} == {"ca", "central", "gpu1", "r1"}


def test_its_commands_make_certificates_and_rules(tmp_path: Path) -> None:
    block = re.search(r"```sh\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert block is not None
    run(block[1], tmp_path)
    made = {file.name for file in (tmp_path / "pki").iterdir()}
    assert made == {f"{name}.{kind}" for name in ("ca", "central", "gpu1", "r1", "ann") for kind in ("pem", "key")}
    rules = json.loads((tmp_path / "access.json").read_text(encoding="utf-8"))
    assert len(rules["subjects"]) == 203


def test_it_has_every_role() -> None:
    told = re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert told == list(Role)
