import io

from msgspec.structs import replace
from rich.console import Console

from schemas.detections import ClassCount
from schemas.keys import CameraKey
from services.monitor.display import line, notes_of, render
from services.monitor.fleet import Age, Row

BUSY = Row(
    CameraKey("r1", "front"),
    online=True,
    classes=(ClassCount("box", 3, 0.9), ClassCount("pallet", 1, 0.5)),
    age=Age(0.24, exact=True),
    rate_hz=2.04,
)
LOST = Row(CameraKey("r2", "front"), online=False, classes=(), age=Age(9, exact=False), rate_hz=0)
NEW = Row(CameraKey("r3", "front"), online=True, classes=None, age=None, rate_hz=0)


def drawn(*rows: Row, notes: tuple[str, ...] = (), more: int = 0) -> str:
    console = Console(file=io.StringIO(), width=100)
    console.print(render(rows, notes, more))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_every_column_of_every_row() -> None:
    shown = [
        [cell.strip() for cell in row.split("│")[1:-1]] for row in drawn(BUSY, LOST, NEW).splitlines() if "│" in row
    ]
    assert shown == [
        ["r1", "front", "online", "3 box, 1 pallet", "0.2 s", "2.0/s"],
        ["r2", "front", "offline", "nothing", "> 9.0 s", "0.0/s"],
        ["r3", "front", "online", "waiting for class lists", "-", "0.0/s"],
    ]


def test_a_camera_that_nobody_speaks_for_is_silent_on_a_terminal_too() -> None:
    assert "silent" in drawn(replace(BUSY, age=Age(9, exact=True)))
    assert "silent" not in drawn(BUSY)


def test_an_empty_fleet_says_so_and_notes_are_shown() -> None:
    shown = drawn(notes=("listening on tcp/127.0.0.1:7447",))
    assert "no cameras yet" in shown
    assert "listening on tcp/127.0.0.1:7447" in shown


def test_names_are_never_markup() -> None:
    shady = Row(CameraKey("r1", "front"), online=True, classes=(ClassCount("[red]x[/red]", 1, 1),), age=None, rate_hz=0)
    assert "1 [red]x[/red]" in drawn(shady)


def test_plain_line() -> None:
    assert line(BUSY, "online") == "r1/front: online, 3 box, 1 pallet, age 0.2 s, 2.0/s"


def test_what_does_not_fit_is_counted() -> None:
    assert "and 1 more cameras" in drawn(BUSY, LOST, more=1)
    assert "more cameras" not in drawn(BUSY, LOST)


def test_what_was_left_out_is_said() -> None:
    assert notes_of({}) == []
    assert notes_of({"malformed messages": 3, "b": 1}) == ["left out: 1 b, 3 malformed messages"]


def test_a_models_names_write_nothing_but_themselves() -> None:
    hostile = Row(
        CameraKey("r1", "front"),
        online=True,
        classes=(ClassCount("\x1b[2Jbox\nr2/front: online", 1, 0.9),),
        age=None,
        rate_hz=0,
    )
    assert r": online, 1 \x1b[2Jbox\nr2/front: online, age" in line(hostile, "online")
    shown = drawn(hostile)
    assert r"\x1b[2Jbox\nr2/front" in shown
    assert "\x1b" not in shown
