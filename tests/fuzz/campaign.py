"""Feeds spoilt inputs to all targets in turn, and accounts for errors, time and memory of every one."""

from __future__ import annotations

import logging
import signal
import time
import traceback
import tracemalloc
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING, Final

from tests.fuzz.mutation import mutate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from tests.fuzz.target import Target

MAX_SECONDS: Final = 1.0
"""Of processor time; a hanging input ends here, and nothing that works comes near."""
MAX_PEAK_BYTES: Final = 4 << 20
"""For inputs of at most `mutation.MAX_BYTES`: what they hold may be some dozen times as large as they are."""
MEASURE_EVERY: Final = 101  # no divisor of the number of targets, so that all get their turn
MAX_FINDINGS: Final = 50


class TooSlowError(Exception):
    """An input takes too long."""


@dataclass(frozen=True, slots=True)
class Finding:
    """An input that a target did not take as documented."""

    target: str
    what: str
    where: str
    data: str


@dataclass(slots=True)
class Report:
    """The account of a campaign; `refused` inputs raised what is documented."""

    inputs: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    findings: dict[tuple[str, str, str], Finding] = field(default_factory=dict)
    slowest_s: float = 0.0
    slowest: str = ""
    peak_bytes: int = 0
    peak: str = ""

    def find(self, target: Target, data: bytes, what: str, where: str = "") -> None:
        key = (target.name, what.partition(":")[0], where)
        if len(self.findings) < MAX_FINDINGS:
            self.findings.setdefault(key, Finding(target.name, what[:300], where, data.hex()))


def run(
    targets: Sequence[Target],
    *,
    inputs: int,
    seed: int,
    max_seconds: float = MAX_SECONDS,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Feed `inputs` inputs, the same ones for the same seed."""
    report, rng = Report(), Random(seed)  # noqa: S311 - no secret
    with _quiet(), _alarm():
        for number in range(inputs):
            target = targets[number % len(targets)]
            data = _input(target, rng)
            if number % MEASURE_EVERY == 0:
                _measured(report, target, data, rng, max_seconds)
            else:
                _feed(report, target, data, rng, max_seconds)
            if progress is not None:
                progress(number + 1)
    return report


def _input(target: Target, rng: Random) -> bytes:
    if target.made is None or rng.random() < 0.5:
        return mutate(rng, target.seeds)
    made = target.made(rng)
    return made if rng.random() < 0.5 else mutate(rng, (made,))


def _feed(report: Report, target: Target, data: bytes, rng: Random, max_seconds: float) -> None:
    report.inputs[target.name] += 1
    signal.setitimer(signal.ITIMER_VIRTUAL, max_seconds)
    started = time.process_time()
    try:
        target.feed(data, rng)
    except target.documented:
        report.refused[target.name] += 1
    except Exception as error:  # noqa: BLE001 - this is what is looked for
        frame = traceback.extract_tb(error.__traceback__)[-1]
        report.find(target, data, f"{type(error).__name__}: {error}", f"{frame.filename}:{frame.lineno}")
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    took = time.process_time() - started
    if took > report.slowest_s:
        report.slowest_s, report.slowest = took, target.name


def _measured(report: Report, target: Target, data: bytes, rng: Random, max_seconds: float) -> None:
    tracemalloc.start()
    try:
        _feed(report, target, data, rng, max_seconds)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    if peak > report.peak_bytes:
        report.peak_bytes, report.peak = peak, target.name
    if peak > MAX_PEAK_BYTES:
        report.find(target, data, f"memory: {peak} bytes for an input of {len(data)}")


@contextmanager
def _quiet() -> Iterator[None]:
    before = logging.root.manager.disable
    logging.disable()
    try:
        yield
    finally:
        logging.disable(before)


@contextmanager
def _alarm() -> Iterator[None]:
    def ring(_number: int, _frame: object) -> None:
        raise TooSlowError("still not done")

    before = signal.signal(signal.SIGVTALRM, ring)
    try:
        yield
    finally:
        signal.signal(signal.SIGVTALRM, before)
