"""Turns Zenoh's panics into BusError."""

from bus.errors import BusError


class _PanicsAreErrors:
    """A class instead of a generator, for speed: one is entered for every message."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        if kind is not None and kind.__module__ == "pyo3_runtime":
            raise BusError(f"Zenoh failed: {' '.join(str(error).split())}") from error


_PANICS_ARE_ERRORS = _PanicsAreErrors()


def panics_are_errors() -> _PanicsAreErrors:
    """Raise BusError when Zenoh panics: its own error is no Exception and would end a thread silently."""
    return _PANICS_ARE_ERRORS
