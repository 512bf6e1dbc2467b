"""How far a run is, where it does not disturb the figures."""

import sys


def note(text: str) -> None:
    """Show a line."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def note_step(stage: str, done: int, total: int, every: int) -> None:
    """Show how far a stage is, after so many steps each and at its end."""
    if done == total or not done % every:
        note(f"{stage} {done}/{total}")
