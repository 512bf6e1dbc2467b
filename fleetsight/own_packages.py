"""Our own packages are found first: a sourced ROS workspace may have a `services` or a `bus` of its own on its path."""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from os.path import realpath
from pathlib import Path
from types import ModuleType
from typing import Final

CLIENT: Final = ("bus", "schemas")
"""Packages that `import fleetsight` needs; a program that uses it keeps its own `services` and `gateway`."""

ALL: Final = (*CLIENT, "gateway", "services")
"""Packages that the processes of the fleet need."""

ROOT: Final = str(Path(__file__).parents[1])
"""The folder that these packages and this one are installed in."""

CURE: Final = "rename that one, or use fleetsight in a process of its own"


class OwnPackages(MetaPathFinder):
    """Finds our top-level packages whatever comes before them on `sys.path`, and nothing else."""

    def __init__(self) -> None:
        self.names: set[str] = set()

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None = None,
        target: ModuleType | None = None,  # noqa: ARG002 - of the protocol
    ) -> ModuleSpec | None:
        """Return where one of our packages, or a module in one, is.

        Raises:
            ModuleNotFoundError: there is no such module of ours, and ours hides another package that may have it.
        """
        name = fullname.partition(".")[0]
        if name not in self.names:
            return None
        found = PathFinder.find_spec(fullname, [ROOT] if name == fullname else path)
        if found is None and (other := _other(name)):
            ours = str(Path(ROOT, name))
            raise ModuleNotFoundError(
                f"no {fullname} in {ours}: fleetsight needs {name!r} to be that package, not {other}; {CURE}", name=name
            )
        return found


_finder: Final = OwnPackages()


def put_first(names: Sequence[str]) -> None:
    """Have `import` find our packages of these names from now on.

    Raises:
        ImportError: another package of such a name has been imported in this process already.
    """
    for name in names:
        if (loaded := sys.modules.get(name)) and not _is_ours(name, loaded):
            where = getattr(loaded, "__file__", None) or next(iter(getattr(loaded, "__path__", [])), "elsewhere")
            raise ImportError(f"{name!r} is another package here than fleetsight's: {where}; {CURE}", name=name)
    _finder.names.update(names)
    if _finder not in sys.meta_path:
        sys.meta_path.insert(0, _finder)


def _is_ours(name: str, loaded: ModuleType) -> bool:
    return realpath(Path(ROOT, name)) in {realpath(each) for each in getattr(loaded, "__path__", [])}


def _other(name: str) -> str | None:
    """Return the folder of a package of the same name elsewhere on `sys.path`."""
    elsewhere = [each for each in sys.path if realpath(each or ".") != realpath(ROOT)]
    found = PathFinder.find_spec(name, elsewhere)
    if found is None:
        return None
    return next(iter(found.submodule_search_locations or []), found.origin)
