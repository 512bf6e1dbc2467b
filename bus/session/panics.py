"""Zenoh's panics, which Python code would not expect."""

from bus.errors import BusError


class _PanicsAreErrors:
    """A class of its own and not a generator: one is entered for every message."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        if kind is not None and kind.__module__ == "pyo3_runtime":
            raise BusError(f"Zenoh failed: {' '.join(str(error).split())}") from error


_PANICS_ARE_ERRORS = _PanicsAreErrors()


def panics_are_errors() -> _PanicsAreErrors:
    """Raise BusError where Zenoh panics: what it raises is no Exception, and would end a thread without a word."""
    return _PANICS_ARE_ERRORS
