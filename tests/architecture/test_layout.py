"""The layout stays as easy to find one's way in as it is: few entries in a folder, no long files, few fragments."""

import ast
from collections import Counter, defaultdict
from pathlib import Path
from statistics import median

ROOT = Path(__file__).parents[2]
PACKAGES = ("schemas", "bus", "gateway", "services", "fleetsight")
MAX_ENTRIES = 26
"""In one folder, `__init__.py` included, but for MARKERS."""

MARKERS = {"py.typed"}

MAX_LINES = 350
MAX_FILES = 592
MIN_MEDIAN_LINES = 110
MAX_WITH_ONE_IMPORTER = 165


def modules() -> dict[str, Path]:
    """Return the path of each module of ours by its name, packages' own left out."""
    paths = (path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths if path.name != "__init__.py"
    }


def length(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def importers() -> dict[str, set[str]]:
    """Return which modules and packages import each module."""
    known, found = modules(), defaultdict[str, set[str]](set)
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                names = {f"{node.module}.{each.name}" for each in node.names} | {node.module}
                for name in names & known.keys():
                    found[name].add(str(path))
    return found


def test_folders_have_few_entries() -> None:
    entries = Counter(
        str(path.parent.relative_to(ROOT))
        for package in (*PACKAGES, "tests", "benchmarks")
        for path in (ROOT / package).rglob("*")
        if "__pycache__" not in path.parts and path.name not in MARKERS
    )
    assert entries
    assert not {folder: count for folder, count in entries.items() if count > MAX_ENTRIES}


def test_no_file_is_long() -> None:
    folders = (*PACKAGES, "tests", "benchmarks")
    lengths = {
        str(path.relative_to(ROOT)): length(path) for folder in folders for path in (ROOT / folder).rglob("*.py")
    }
    assert lengths
    assert not {name: lines for name, lines in lengths.items() if lines > MAX_LINES}


def test_files_hold_a_concept_each() -> None:
    lengths = [length(path) for path in modules().values()]
    assert len(lengths) <= MAX_FILES
    assert median(lengths) >= MIN_MEDIAN_LINES


def test_few_modules_are_a_fragment_of_their_only_importer() -> None:
    alone = [name for name, found in importers().items() if len(found) == 1]
    assert alone
    assert len(alone) <= MAX_WITH_ONE_IMPORTER
