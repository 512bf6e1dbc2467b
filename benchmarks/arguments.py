"""What benchmarks take on their command lines, and what they print."""

import argparse
import json
from collections.abc import Mapping
from typing import Any


def parser_of(module: str, about: str | None) -> argparse.ArgumentParser:
    """Return the parser of a benchmark's command line, which has --json."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {module}", description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def show(found: Mapping[str, Any], *, as_json: bool) -> None:
    """Print what was found: as one JSON object, or a line for each figure."""
    print(json.dumps(found) if as_json else "\n".join(f"{name}: {value}" for name, value in found.items()))


def at_least_one(text: str) -> int:
    """Read a count.

    Raises:
        argparse.ArgumentTypeError: it is less than 1.
    """
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return count
