"""The live picture: a table on a terminal, changed lines anywhere else."""

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import IO, Final

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from services.monitor.fleet import Fleet
from services.monitor.table import classes, line, notes_of, render
from services.monitor.troubles import troubles

FRAME_LINES: Final = 8
"""Lines of the picture beside the rows: title, head, rules and notes."""


MAX_LINES: Final = 50
"""Lines of changed cameras written at a time: thousands a second would help nobody."""

AT_ONCE: Final = 200
"""Cameras looked at before other things get their turn."""

Problems = Callable[[], Sequence[str]]
"""Says what keeps the monitor itself from doing all that it should."""


async def show(fleet: Fleet, console: Console, refresh_s: float, *, note: str, problems: Problems = lambda: ()) -> None:
    """Show the fleet until cancelled."""

    def every_trouble() -> list[str]:
        return [*problems(), *troubles(fleet.online())]

    if not console.is_terminal:
        console.print(note, markup=False, highlight=False, soft_wrap=True)
        await _print_changes(fleet, refresh_s, every_trouble, console.file)
        return
    with Live(console=console, auto_refresh=False) as live:
        while True:
            wrong = [Text(each, "yellow", no_wrap=True, overflow="ellipsis") for each in every_trouble()]
            room = max(1, console.height - FRAME_LINES - len(wrong))
            picture = render(fleet.rows(time.monotonic()), [*notes_of(fleet.left_out), note], room)
            live.update(Group(picture, *wrong), refresh=True)
            await asyncio.sleep(refresh_s)


async def _print_changes(fleet: Fleet, refresh_s: float, every_trouble: Callable[[], list[str]], to: IO[str]) -> None:
    """Write a camera's line when its state or what is in view of it changes, and what goes wrong."""
    shown: dict[object, tuple[bool, str]] = {}
    wrong: set[str] = set()
    while True:
        changed = 0
        for number, row in enumerate(fleet.rows(time.monotonic()), 1):
            state = (row.online, classes(row))
            if shown.get(row.key) != state:
                shown[row.key] = state
                changed += 1
                if changed <= MAX_LINES:
                    to.write(f"{line(row)}\n")
            if number % AT_ONCE == 0:
                await asyncio.sleep(0)
        if changed > MAX_LINES:
            to.write(f"and {changed - MAX_LINES} more cameras changed\n")
        now_wrong = every_trouble()
        to.writelines(f"{each}\n" for each in now_wrong if each not in wrong)
        to.flush()
        wrong = set(now_wrong)
        await asyncio.sleep(refresh_s)
