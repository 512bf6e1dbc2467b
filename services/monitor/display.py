"""The terminal display: a live table on a terminal, changed lines elsewhere.

A slow reader blocks nothing: output is written on a daemon thread, and the next picture has all changes. If it cannot
be written, as on a full disk, the monitor continues without it.
"""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import chain, islice
from typing import IO, Final

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from schemas.keys import CameraKey
from schemas.printing import printable
from services.monitor.event_loop.blocking_calls import in_daemon_thread
from services.monitor.event_loop.cooperative_yielding import in_turns
from services.monitor.fleet import Age, Fleet, Row
from services.monitor.formats import limited, problem_lines
from services.monitor.inventory.availability import AvailabilityTracker
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.inventory import Inventory

STYLES: Final = {"online": "green", "silent": "yellow", "offline": "bold red"}


def render(rows: Iterable[Row], notes: Sequence[str], more: int) -> Table:
    """Render rows, and how many are left out; stale ones are grey, a lost robot stays."""
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
    """Return a note about messages that were left out, if any."""
    listed = ", ".join(f"{count} {what}" for what, count in sorted(left_out.items()))
    return [f"left out: {listed}"] if listed else []


def line(row: Row, state: str) -> str:
    """Return the row as one plain line."""
    return f"{row.key}: {state}, {classes(row)}, age {age(row.age)}, {row.rate_hz:.1f}/s"


def classes(row: Row) -> str:
    """Return the classes in view as text that is safe on a terminal: model class names are arbitrary."""
    if row.classes is None:
        return "waiting for class lists"
    return ", ".join(f"{seen.count} {printable(seen.name)}" for seen in row.classes) or "nothing"


def age(value: Age | None) -> str:
    """Return an age in seconds, with '>' where only a lower bound is known."""
    if value is None:
        return "-"
    return f"{'' if value.exact else '> '}{value.seconds:.1f} s"


log = logging.getLogger(__name__)

FRAME_LINES: Final = 8
"""Lines of the table that are not rows: title, head, rules and notes."""

MAX_LINES: Final = 50
"""Maximum number of lines for changed cameras, or problems, per update."""

FAREWELL_S: Final = 0.5
"""Seconds allowed for restoring the terminal."""

AGAIN_S: Final = 10.0
"""Seconds before a failed write is retried."""

Problems = Callable[[], Sequence[str]]
"""Returns the monitor's own problems."""

Writer = Callable[[Callable[[], object]], Awaitable[None]]
"""Runs a blocking write beside the event loop."""


async def show(fleet: Fleet, console: Console, refresh_s: float, *, note: str, problems: Problems = lambda: ()) -> None:
    """Show the fleet until cancelled. A failed write is logged once; everything is shown once it succeeds again.

    Raises:
        BrokenPipeError: the reader closed the output.
    """

    def every_trouble() -> list[str]:
        return [
            *problems(),
            *problem_lines({status.robot: fleet.problems_of(status.robot) for status in fleet.online()}),
        ]

    lost = False

    async def write(act: Callable[[], object]) -> None:
        nonlocal lost
        await in_daemon_thread(act)
        lost = False

    while True:
        try:
            if console.is_terminal:
                await _draw(fleet, console, refresh_s, note, every_trouble, write=write)
            else:
                await write(lambda: console.print(note, markup=False, highlight=False, soft_wrap=True))
                await _print_changes(fleet, refresh_s, every_trouble, console.file, write=write)
        except BrokenPipeError:
            raise
        except OSError as error:
            if not lost:
                log.warning(
                    "the fleet is not shown until the output is writable: %s",
                    error.strerror or error,
                )
            lost = True
        await asyncio.sleep(AGAIN_S)


async def _draw(
    fleet: Fleet,
    console: Console,
    refresh_s: float,
    note: str,
    every_trouble: Callable[[], list[str]],
    *,
    write: Writer,
) -> None:
    live = Live(console=console, auto_refresh=False)
    try:
        await write(live.start)
        while True:
            wrong = [Text(each, "yellow", no_wrap=True, overflow="ellipsis") for each in limited(every_trouble())]
            room = max(1, console.height - FRAME_LINES - len(wrong))
            rows = list(islice(fleet.rows(time.monotonic()), room))
            picture = Group(render(rows, [*notes_of(fleet.left_out), note], fleet.cameras - len(rows)), *wrong)
            await write(partial(live.update, picture, refresh=True))
            await asyncio.sleep(refresh_s)
    finally:
        with suppress(OSError):  # TimeoutError is one
            async with asyncio.timeout(FAREWELL_S):
                await in_daemon_thread(live.stop)


async def _print_changes(
    fleet: Fleet, refresh_s: float, every_trouble: Callable[[], list[str]], to: IO[str], *, write: Writer
) -> None:
    """Write a line per camera whose state or view changed, and per problem."""
    shown: dict[CameraKey, tuple[str, str]] = {}
    wrong: set[str] = set()
    silence = SilentCameras(fleet.inventory)
    fleet.take_changed(time.monotonic())
    rows = fleet.rows(time.monotonic())
    while True:
        lines: list[str] = []
        rest: Counter[str] = Counter()
        turned = silence.advance(time.time_ns())
        async for row in in_turns(chain(rows, (fleet.row(key, time.monotonic()) for key in turned))):
            state = silence.state_of(row)
            if shown.get(row.key) != (state, classes(row)):
                shown[row.key] = (state, classes(row))
                if len(lines) < MAX_LINES:
                    lines.append(line(row, state))
                else:
                    rest[state] += 1
        if rest:
            states = ", ".join(f"{count} {state}" for state, count in rest.items())
            lines.append(f"and {rest.total()} more cameras changed: {states}")
        now_wrong = every_trouble()
        lines += limited([each for each in now_wrong if each not in wrong], MAX_LINES)
        wrong = set(now_wrong)
        if lines:
            await write(partial(_write, to, "".join(f"{each}\n" for each in lines)))
        await asyncio.sleep(refresh_s)
        rows = fleet.take_changed(time.monotonic())


class SilentCameras:
    """Finds silent cameras: they are online, but no class lists arrive."""

    def __init__(self, inventory: Inventory) -> None:
        self._inventory = inventory
        self._availability = AvailabilityTracker(inventory, inventory.is_available, available=False)
        self._silent: set[CameraKey] = set()
        inventory.on_leave(self._leave)

    def _leave(self, left: Collection[CameraView]) -> None:
        self._silent.difference_update(view.key for view in left)

    def advance(self, now_ns: int) -> list[CameraKey]:
        """Return the cameras that fell silent or resumed by `now_ns`."""
        turned = self._availability.advance(now_ns)
        for camera in turned:
            available = self._inventory.is_available(camera, now_ns)
            (self._silent.discard if available else self._silent.add)(camera.key)
        return [camera.key for camera in turned]

    def state_of(self, row: Row) -> str:
        """Return a camera's state in one word; a camera without any class list yet is waiting, not silent."""
        if not row.online:
            return "offline"
        return "silent" if row.key in self._silent else "online"


def _write(to: IO[str], text: str) -> None:
    to.write(text)
    to.flush()
