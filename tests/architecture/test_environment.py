"""Only settings modules and entry points read the environment or arguments."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("fleetsight", "schemas", "bus", "gateway", "services")
READERS = ("settings.py", "__main__.py")
MAY_ALSO = {
    "gateway/to_ros/done_actions.py": "reads which folder systemd gives the gateway for what it keeps",
    "services/detector/runtime/offline.py": "tells Ultralytics, through its environment, to stay off the network",
    "services/training/trainer.py": "tells Ultralytics, through its environment, to stay off the network",
    "services/monitor/history/backup.py": "gives PostgreSQL's programs their connection in an environment of their own",
    "services/service_manager.py": "reads what systemd tells each process, and keeps it from its children",
    "services/toolbox/demo/children.py": "gives its processes an environment of their own",
}


def sources() -> Iterator[Path]:
    for room in ROOMS:
        yield from (ROOT / room).rglob("*.py")


SOURCES = {("os", "environ"), ("os", "getenv"), ("sys", "argv")}


def reads_environment(tree: ast.AST) -> bool:
    return any(_names(node) & SOURCES for node in ast.walk(tree))


def _names(node: ast.AST) -> set[tuple[str, str]]:
    match node:
        case ast.Attribute(value=ast.Name(id=module), attr=name):
            return {(module, name)}
        case ast.ImportFrom(module=str(module), names=names):
            return {(module, alias.name) for alias in names}
    return set()


def test_who_reads_the_environment() -> None:
    found = {str(path.relative_to(ROOT)) for path in sources() if reads_environment(ast.parse(path.read_text()))}
    others = {path for path in found if Path(path).name not in READERS}
    assert others == set(MAY_ALSO)


def test_no_module_is_a_drawer_for_everything() -> None:
    assert not [path for path in sources() if path.stem in {"utils", "util", "helpers", "misc", "common"}]
