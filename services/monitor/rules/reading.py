"""Reading rule files; why one cannot be read is said in words."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.monitor.rules.loading import MAX_CHARACTERS, RuleFileError


@contextmanager
def reading() -> Iterator[None]:
    """Make a RuleFileError of whatever keeps a file from being read."""
    try:
        yield
    except (OSError, UnicodeDecodeError) as error:
        raise RuleFileError(None, getattr(error, "strerror", None) or str(error)) from error


def text_of(path: Path) -> str:
    """Return what is in a rule file; of one that is too long as much as `load_rules` needs to refuse it.

    Raises:
        RuleFileError: it cannot be read.
    """
    with reading(), path.open(encoding="utf-8") as file:
        return file.read(MAX_CHARACTERS + 1)
