"""`python -m tests.fuzz`: spoilt inputs for every parser; whatever is not as documented fails the command."""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.fuzz import campaign, message_targets, name_targets, return_targets, wire_targets

if TYPE_CHECKING:
    from tests.fuzz.campaign import Report

HEADROOM_BYTES = 512 << 20
PROGRESS_EVERY = 20_000
TARGETS = [*wire_targets.TARGETS, *message_targets.TARGETS, *return_targets.TARGETS, *name_targets.TARGETS]


def main() -> int:
    options = _options()
    _limit_memory()
    rss, started = _rss_kib(), time.perf_counter()
    report = campaign.run(TARGETS, inputs=options.inputs, seed=options.seed, progress=_progress(options.inputs))
    summary = _summary(report, time.perf_counter() - started, _rss_kib() - rss)
    sys.stdout.write(json.dumps(summary, indent=2) + "\n" if options.json else _text(summary))
    return 1 if report.findings else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


def _limit_memory() -> None:
    """Have an allocation fail that goes far beyond what the process has at its start."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + HEADROOM_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _rss_kib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _progress(total: int) -> Any:
    def show(done: int) -> None:
        if done % PROGRESS_EVERY == 0:
            sys.stderr.write(f"\r{done} of {total} inputs")
            sys.stderr.flush()

    return show


def _summary(report: Report, seconds: float, rss_kib: int) -> dict[str, Any]:
    inputs = report.inputs.total()
    return {
        "inputs": inputs,
        "seconds": round(seconds, 1),
        "inputs_per_s": round(inputs / seconds),
        "refused": report.refused.total(),
        "targets": {name: {"inputs": n, "refused": report.refused[name]} for name, n in report.inputs.items()},
        "slowest_ms": round(1000 * report.slowest_s, 1),
        "slowest": report.slowest,
        "peak_bytes": report.peak_bytes,
        "peak": report.peak,
        "rss_growth_mb": round(rss_kib / 1024, 1),
        "findings": [asdict(finding) for finding in report.findings.values()],
    }


def _text(summary: dict[str, Any]) -> str:
    lines = [f"{key}: {value}" for key, value in summary.items() if key not in {"targets", "findings"}]
    found = [f"{each['target']}: {each['what']} at {each['where']}: {each['data']}" for each in summary["findings"]]
    return "\n".join(["", *lines, f"findings: {len(found)}", *found, ""])


sys.exit(main())
