"""Files that a training run keeps."""

import resource
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import msgspec
from pydantic import BaseModel

from services.training import parallel
from services.training.parallel import Progress
from services.whole_file import write_whole


class TrainingError(Exception):
    """The run cannot go on; the message is one line for the user."""


def first_line(error: Exception) -> str:
    """Return the first line of another library's error, or its type."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def keep_file(file: Path, content: bytes) -> None:
    """Write a file of a run.

    Raises:
        TrainingError: it cannot be written; the message names it.
    """
    try:
        write_whole(file, content)
    except OSError as error:
        raise TrainingError(f"{file}: {error.strerror or error}") from error


Made = TypeVar("Made", bound=msgspec.Struct)
_Job = tuple[Path, int, Callable[[int], msgspec.Struct]]


def kept(
    folder: Path, seeds: Sequence[int], make: Callable[[int], Made], kind: type[Made], *, workers: int, report: Progress
) -> Iterator[Made]:
    """Yield the results of `make` (importable in other processes) for each seed, in order, once all are made.

    Results that are already in `folder` are reused. report: called with the stage "render scenes".

    Raises:
        TrainingError: a file there is damaged, or cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{seed:09d}.msgpack" for seed in seeds]
    missing: list[_Job] = [(file, seed, make) for file, seed in zip(files, seeds, strict=True) if not file.exists()]
    before = len(seeds) - len(missing)
    report("render scenes", before, len(seeds))
    parallel.run(_write, missing, workers, lambda done: report("render scenes", before + done, len(seeds)))
    for file in files:
        yield _read(file, kind)


def _write(job: _Job) -> None:
    file, seed, make = job
    keep_file(file, msgspec.msgpack.encode(make(seed)))


def _read(file: Path, kind: type[Made]) -> Made:
    try:
        return msgspec.msgpack.decode(file.read_bytes(), type=kind)
    except msgspec.DecodeError as error:
        raise TrainingError(f"{file}: damaged ({error}); remove it") from error


class Effort(BaseModel):
    """Seconds by the clock, and seconds of processor time of this process and its children."""

    wall_s: float = 0.0
    cpu_s: float = 0.0


def effort_so_far(record: Path) -> Effort:
    """Return the effort noted in `record`, zero at first."""
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
