"""How far a run is, where it does not disturb the figures."""

import sys


def note(text: str) -> None:
    """Show a line."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
