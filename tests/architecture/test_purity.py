"""Modules that decide are pure: time is an argument, and nothing in them reads a clock, a file, a socket or a database.

A module is marked by the word "Pure" in its docstring, a package with all its modules by the one in its `__init__`.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("schemas", "bus", "gateway", "services", "fleetsight")
IMPURE = frozenset(
    {
        "asyncio",
        "httpx",
        "logging",
        "os",
        "random",
        "secrets",
        "socket",
        "sqlalchemy",
        "starlette",
        "subprocess",
        "threading",
        "time",
        "zenoh",
    }
)
FILE_METHODS = frozenset({"open", "read_bytes", "read_text", "write_bytes", "write_text"})
"""Methods of paths. `Image.open` is not meant: pure modules give it bytes."""

FEWEST = 150
"""How many modules are marked at least: a mark is not dropped to get around this test."""


def is_marked(path: Path) -> bool:
    return re.search(r"\bPure\b", ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "") is not None


def pure_modules() -> Iterator[Path]:
    """Yield the modules that are marked, or that belong to a marked package."""
    for path in (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))):
        packages = [parent / "__init__.py" for parent in path.relative_to(ROOT).parents if parent.name]
        if is_marked(path) or any(is_marked(ROOT / package) for package in packages if (ROOT / package).exists()):
            yield path


def imported_by(source: str) -> set[str]:
    """Return the top-level names of the packages that a module imports, wherever in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {each.name.partition(".")[0] for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return found


def files_accessed_by(source: str) -> set[str]:
    """Return the calls in a module that read or write a file, other than those of modules that it may not import."""
    calls = [node.func for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    functions = {each.id for each in calls if isinstance(each, ast.Name)} & {"open"}
    methods = [each for each in calls if isinstance(each, ast.Attribute) and each.attr in FILE_METHODS]
    return functions | {each.attr for each in methods if ast.unparse(each.value) != "Image"}


def test_pure_modules_import_nothing_impure() -> None:
    pure = list(pure_modules())
    assert len(pure) >= FEWEST
    impure = {
        str(path.relative_to(ROOT)): sorted(found)
        for path in pure
        if (found := imported_by(path.read_text(encoding="utf-8")) & IMPURE)
    }
    assert not impure


@pytest.mark.parametrize("source", ["import time", "from os import path", "def f():\n    import asyncio"])
def test_every_form_of_import_is_seen(source: str) -> None:
    assert imported_by(source) & IMPURE


def test_pure_modules_access_no_files() -> None:
    found = {
        str(path.relative_to(ROOT)): sorted(calls)
        for path in pure_modules()
        if (calls := files_accessed_by(path.read_text(encoding="utf-8")))
    }
    assert not found


@pytest.mark.parametrize("source", ["open(name)", "with path.open() as file:\n    pass", "(folder / name).read_text()"])
def test_every_form_of_file_access_is_seen(source: str) -> None:
    assert files_accessed_by(source)


def test_images_in_memory_are_no_files() -> None:
    assert not files_accessed_by("Image.open(BytesIO(data))")
