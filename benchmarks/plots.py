"""Draws the pictures that README and docs show, each from one kept JSON file alone.

The same file gives the same bytes. A picture whose benchmark was never run is left out; one that lacks a figure stays
as it was, is named, and makes the exit code 1.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.plotting.figures import Figures, NoFigureError
from benchmarks.plotting.pictures import PICTURES
from benchmarks.plotting.style import svg


def draw(results: Path, plots: Path) -> list[str]:
    """Draw what there are results of; return what could not be drawn, and why.

    Raises:
        OSError: a file cannot be read or written.
    """
    wrong = []
    for name, picture in PICTURES.items():
        kept = results / f"{picture.benchmark}.json"
        if not kept.exists():
            sys.stderr.write(f"{name}: {kept} is not there\n")
            continue
        try:
            drawn = svg(picture.draw(Figures(json.loads(kept.read_bytes()))))
        except (NoFigureError, ValueError) as error:
            wrong.append(f"{kept}: {error}")
            continue
        (plots / f"{name}.svg").write_bytes(drawn)
        sys.stderr.write(f"{plots / name}.svg\n")
    return wrong


def main(argv: Sequence[str] | None = None) -> None:
    """Draw."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.plots", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, default=Path("benchmarks/results"), help="(default: %(default)s)")
    parser.add_argument("--plots", type=Path, default=Path("docs/plots"), help="(default: %(default)s)")
    arguments = parser.parse_args(argv)
    try:
        arguments.plots.mkdir(parents=True, exist_ok=True)
        wrong = draw(arguments.results, arguments.plots)
    except OSError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    sys.stderr.writelines(f"{parser.prog}: {line}\n" for line in wrong)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
