"""Files that a training run keeps."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import msgspec

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
