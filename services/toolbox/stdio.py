"""The standard streams: ensures that all three exist, and distinguishes output errors from others."""

import io
import os
import sys


class PrintError(OSError):
    """The output cannot be written."""


class Printed(io.TextIOWrapper):
    """Standard output.

    Raises:
        PrintError: it cannot be written; a reader who has read enough is a BrokenPipeError as ever.
    """

    def write(self, text: str) -> int:
        """Write text."""
        try:
            return super().write(text)
        except BrokenPipeError:
            raise
        except OSError as error:
            raise PrintError(error.errno, error.strerror) from error


def prepare() -> None:
    """Open /dev/null for each closed stream, before a file or a socket takes its number."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    sys.stdin = sys.stdin or open(0, encoding="utf-8")  # noqa: SIM115 - for as long as the process lives
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8")  # noqa: SIM115
    stdout = sys.stdout or open(1, "w", encoding="utf-8")  # noqa: SIM115
    if isinstance(stdout, io.TextIOWrapper):
        line_buffering, write_through = stdout.line_buffering, stdout.write_through
        encoding, errors = stdout.encoding, stdout.errors
        sys.stdout = Printed(
            stdout.detach(), encoding, errors, line_buffering=line_buffering, write_through=write_through
        )
        sys.__stdout__ = sys.stdout  # type: ignore[misc]  # whose terminal's width is asked for
