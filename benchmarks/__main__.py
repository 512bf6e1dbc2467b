"""Runs benchmarks one after another, each a process of its own, and keeps a JSON file of each.

A file has what the benchmark found on which machine, with which versions and seeds, and which targets are met; where it
ran more than once, the least, the median and the greatest of what differs. One that fails or takes too long leaves its
file as it was and does not keep the rest from running. The exit code is 1 then; a missed target does not change it.
"""

import argparse
import asyncio
import datetime as dt
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rich.console import Console

from benchmarks.arguments import at_least_one
from benchmarks.running.display import Display, display
from benchmarks.running.finding import UnknownBenchmarkError, chosen, names_in
from benchmarks.running.process import BenchmarkError, run
from benchmarks.running.record import Run, record
from benchmarks.running.summary import missed, outcome

HERE: Final = Path(__file__).parent
LIMIT_S: Final = 600.0


@dataclass(slots=True)
class Session:
    """Benchmarks of a package that are run so often each, and what became of them.

    commit: what is measured. It is asked for before the first result is written: results are files of the project too.
    """

    package: str
    commit: str
    repeat: int
    limit_s: float
    results: Path
    missed: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    async def run(self, names: Sequence[str], shown: Display) -> None:
        """Run them all.

        Raises:
            OSError: what was found could not be written.
        """
        for name in names:
            command = ["-m", f"{self.package}.{name}", "--json"]
            date = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
            shown.begin(name)
            try:
                runs = [await self._once(number, command, shown) for number in range(1, self.repeat + 1)]
            except BenchmarkError as error:
                shown.ended(f"failed: {error}")
                self.failed.append(f"{name}: {error}")
                continue
            found = record(name, shlex.join(["python", *command]), date, self.commit, runs)
            self.missed += missed(found)
            shown.ended(outcome(found))
            (self.results / f"{name}.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")

    async def _once(self, number: int, command: Sequence[str], shown: Display) -> Run:
        if self.repeat > 1:
            shown.says(f"run {number} of {self.repeat}")
        load, began = os.getloadavg()[0], time.monotonic()
        found = await run([sys.executable, *command], self.limit_s, shown.says)
        return Run(found, time.monotonic() - began, load)


def commit() -> str:
    """Return what is measured, as Git calls it; empty where there is no Git."""
    describe = ["git", "-C", str(HERE), "describe", "--always", "--dirty"]
    try:
        return subprocess.run(describe, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def main(argv: Sequence[str] | None = None, *, package: str = "benchmarks", folder: Path = HERE) -> None:
    """Run benchmarks of a package in a folder."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = names_in(folder)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which: {', '.join(known)} (default: all)")
    parser.add_argument("--repeat", type=at_least_one, default=1, help="how often each is run (default: 1)")
    parser.add_argument("--limit-s", type=float, default=LIMIT_S, help="that one run may take (default: %(default)g)")
    parser.add_argument(
        "--results", type=Path, default=Path("benchmarks/results"), help="folder (default: %(default)s)"
    )
    arguments = parser.parse_args(argv)
    session = Session(package, commit(), arguments.repeat, arguments.limit_s, arguments.results)
    try:
        names = chosen(arguments.names, known)
        session.results.mkdir(parents=True, exist_ok=True)
        with display(Console(stderr=True), len(names)) as shown:
            asyncio.run(session.run(names, shown))
    except (UnknownBenchmarkError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    except KeyboardInterrupt:
        parser.exit(130, "stopped\n")
    for line in [f"missed: {each}" for each in session.missed] + [f"failed: {each}" for each in session.failed]:
        print(line)
    print(f"{len(names) - len(session.failed)} of {len(names)} benchmarks done, in {session.results}")
    sys.exit(1 if session.failed else 0)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by a signal"))
    main()
