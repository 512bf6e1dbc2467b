"""What a run has cost so far, over interruptions."""

import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel


class Effort(BaseModel):
    """Seconds by the clock, and seconds of processor time of this process and its children."""

    wall_s: float = 0.0
    cpu_s: float = 0.0


def effort_so_far(record: Path) -> Effort:
    """What is noted in `record`, nothing at first."""
    return Effort.model_validate_json(record.read_bytes()) if record.exists() else Effort()


@contextmanager
def metered(record: Path) -> Iterator[None]:
    """Add the cost of the block to `record`, also when it is interrupted."""
    wall, cpu = time.monotonic(), _cpu_seconds()
    try:
        yield
    finally:
        before = effort_so_far(record)
        spent = Effort(wall_s=before.wall_s + time.monotonic() - wall, cpu_s=before.cpu_s + _cpu_seconds() - cpu)
        record.write_text(spent.model_dump_json())


def _cpu_seconds() -> float:
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)
