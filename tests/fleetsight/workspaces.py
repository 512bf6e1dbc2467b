"""Installations of fleetsight, and workspaces of somebody else whose packages have the names of ours."""

import os
import sysconfig
import tomllib
import venv
from pathlib import Path
from typing import Final

from fleetsight.own_packages import ALL

ROOT: Final = Path(__file__).parents[2]
DECOY: Final = "a decoy"

SCRIPT: Final = """#!{python}
import sys
from {module} import {function}
if __name__ == "__main__":
    sys.exit({function}())
"""


def install(folder: Path, *, editable: bool = False) -> Path:
    """Make an environment with what a wheel of ours has in it, or an editable install; return its `fleetsight` command.

    Dependencies come from the environment of the tests.
    """
    venv.create(folder, symlinks=True)
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (site,) = folder.glob("lib/python*/site-packages")
    if editable:
        (site / "editable.pth").write_text(str(ROOT))
    for package in [] if editable else declared["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        (site / package).symlink_to(ROOT / package)
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    module, _, function = declared["project"]["scripts"]["fleetsight"].partition(":")
    command = folder / "bin" / "fleetsight"
    command.write_text(SCRIPT.format(python=folder / "bin" / "python", module=module, function=function))
    command.chmod(0o755)
    return command


def decoys(folder: Path, names: tuple[str, ...] = ALL) -> Path:
    """Make packages that are called like ours and cannot be imported; return the folder."""
    for name in names:
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text(f"raise RuntimeError('{DECOY}: {name}')\n")
    return folder


def sourced(workspace: Path) -> dict[str, str]:
    """Return the environment of a shell in which a workspace was sourced."""
    return {**os.environ, "PYTHONPATH": str(workspace)}
