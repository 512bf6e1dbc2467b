"""Zenoh's panics, which Python code would not expect."""

from collections.abc import Iterator
from contextlib import contextmanager

from bus.errors import BusError


@contextmanager
def panics_are_errors() -> Iterator[None]:
    """Raise BusError where Zenoh panics: what it raises is no Exception, and would end a thread without a word."""
    try:
        yield
    except BaseException as error:
        if type(error).__module__ != "pyo3_runtime":
            raise
        raise BusError(f"Zenoh failed: {' '.join(str(error).split())}") from error
