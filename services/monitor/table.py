"""The fleet as a table for a terminal, or as plain lines where there is none."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from rich.table import Table
from rich.text import Text

from schemas.printing import printable
from services.monitor.fleet import Age, Row

STYLES: Final = {"online": "green", "silent": "yellow", "offline": "bold red"}


def render(rows: Iterable[Row], notes: Sequence[str], more: int) -> Table:
    """Draw rows, and how many are left; stale ones grey out, a lost robot stays."""
    rest = [f"and {more} more cameras"] if more else []
    table = Table(title="fleet", title_justify="left", caption="\n".join([*rest, *notes]), caption_justify="left")
    for heading, justify in (
        ("robot", "left"),
        ("camera", "left"),
        ("state", "left"),
        ("in view", "left"),
        ("age", "right"),
        ("rate", "right"),
    ):
        table.add_column(heading, justify=justify)  # type: ignore[arg-type]
    for row in rows:
        table.add_row(
            Text(row.key.robot),
            Text(row.key.camera),
            Text(row.state, STYLES[row.state]),
            Text(classes(row)),
            Text(age(row.age)),
            Text(f"{row.rate_hz:.1f}/s"),
            style="dim" if row.stale else None,
        )
    if not table.rows:
        table.add_row("no cameras yet", *[""] * 5, style="dim")
    return table


def notes_of(left_out: Mapping[str, int]) -> list[str]:
    """Return a note about what the monitor could not take, if there was any."""
    listed = ", ".join(f"{count} {what}" for what, count in sorted(left_out.items()))
    return [f"left out: {listed}"] if listed else []


def line(row: Row, state: str) -> str:
    """Return the row as one plain line."""
    return f"{row.key}: {state}, {classes(row)}, age {age(row.age)}, {row.rate_hz:.1f}/s"


def classes(row: Row) -> str:
    """Return what is in view, in words that a terminal may show: a model's names are whatever its maker called them."""
    if row.classes is None:
        return "waiting for class lists"
    return ", ".join(f"{seen.count} {printable(seen.name)}" for seen in row.classes) or "nothing"


def age(value: Age | None) -> str:
    """Return an age in seconds; '>' where only a lower bound is known."""
    if value is None:
        return "-"
    return f"{'' if value.exact else '> '}{value.seconds:.1f} s"
