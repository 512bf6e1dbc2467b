"""What is said of the aims that are missed is what the kept results say."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from benchmarks.running.record import middle

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = ROOT / "docs" / "benchmarks.md"
ROW: Final = re.compile(r"^\| `(.+)` \| `(.+)` \| (.+) \| (.+) \|$", re.MULTILINE)


def missed() -> Iterator[tuple[str, str, str, str]]:
    """Yield benchmark, figure, aim and median of each target that is not met, as the page writes them."""
    for path in sorted((ROOT / "benchmarks" / "results").glob("*.json")):
        for name, target in json.loads(path.read_text(encoding="utf-8"))["targets"].items():
            if not target["met"]:
                yield path.stem, name, aim(target), found(target)


def aim(target: Mapping[str, Any]) -> str:
    return f">= {target['at_least']:g}" if "at_least" in target else f"<= {target['at_most']:g}"


def found(target: Mapping[str, Any]) -> str:
    value = target["ratio"] if "ratio" in target else target["value"]
    return "unknown" if value is None else f"{middle(value):.3f}"


def test_the_page_names_every_aim_that_is_missed_and_no_other() -> None:
    _, _, section = PAGE.read_text(encoding="utf-8").partition("## Aims that are missed\n")
    assert ROW.findall(section) == list(missed())
