"""Which package may import which: the contracts are in pyproject.toml."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("fleetsight", "schemas", "bus", "gateway", "services")
IMPURE = {"asyncio", "socket", "time", "os"}
LINT = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True, no_logo=True))"


def test_every_contract_is_kept() -> None:
    checked = subprocess.run([sys.executable, "-c", LINT], cwd=ROOT, capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert "0 broken" in checked.stdout


def modules_that_call_themselves_pure() -> Iterator[str]:
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        if path.stem != "__init__" and re.search(r"\bPure\b", ast.get_docstring(ast.parse(path.read_text())) or ""):
            yield ".".join(path.relative_to(ROOT).with_suffix("").parts)


def test_what_calls_itself_pure_is_held_to_it_by_a_contract() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    held = {
        module
        for contract in contracts
        if set(contract.get("forbidden_modules", ())) >= IMPURE
        for module in contract["source_modules"]
    }
    pure = list(modules_that_call_themselves_pure())
    assert len(pure) > 100
    assert not [module for module in pure if not any(module == each or module.startswith(f"{each}.") for each in held)]
