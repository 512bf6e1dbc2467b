"""Files that are there whole or not at all, whatever interrupts their writing."""

from pathlib import Path

from services.simulator.training.errors import TrainingError


def write_whole(file: Path, content: bytes) -> None:
    """Write a file.

    Raises:
        TrainingError: it cannot be written; the message names it.
    """
    partial = file.with_suffix(".part")
    try:
        partial.write_bytes(content)
        partial.replace(file)
    except OSError as error:
        raise TrainingError(f"{file}: {error.strerror or error}") from error
