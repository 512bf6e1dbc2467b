"""The zone file: read again when it changes, written when somebody draws."""

import asyncio
import os
from pathlib import Path

import pytest

from services.monitor.world import zone_file
from services.monitor.world import zones as zones_module
from services.monitor.world.site_objects import World
from services.monitor.world.zone_file import ZoneFile, text_of
from services.monitor.world.zones import MAX_ZONES, Zone, ZoneFileError, load_zones, zone_of

DOCK = Zone(name="dock", site="hall", corners=((0, 0), (4, 0), (4, 3)))
YARD = Zone(name='the "yard": #2 🚚 é', site="on", corners=((-1.5, 0), (0, 0), (0, 2.25)))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "zones.yaml"
    path.write_text(text_of([DOCK]), encoding="utf-8")
    return path


def text_in(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def mode_of(path: Path) -> int:
    return path.stat().st_mode & 0o777


def names_in(folder: Path) -> list[str]:
    return [each.name for each in folder.iterdir()]


def in_force(zones: ZoneFile) -> list[Zone]:
    return list(zones.zones)


async def loaded(path: Path | None) -> ZoneFile:
    found = ZoneFile(path, World())
    await found.load()
    return found


def write_later(path: Path, text: str, seconds: int) -> None:
    path.write_text(text, encoding="utf-8")
    os.utime(path, (seconds, seconds))


@pytest.mark.parametrize("zones", [[], [DOCK], [DOCK, YARD]])
def test_what_is_written_is_read(tmp_path: Path, zones: list[Zone]) -> None:
    path = tmp_path / "zones.yaml"
    path.write_text(text_of(zones), encoding="utf-8")
    assert load_zones(path) == tuple(zones)


async def test_a_change_is_read_once_it_stays_and_a_mistake_leaves_the_zones(file: Path) -> None:
    zones = await loaded(file)
    assert in_force(zones) == [DOCK]
    write_later(file, text_of([DOCK, YARD]), 1)
    await zones.look(file)
    assert in_force(zones) == [DOCK], "it may be half written"
    await zones.look(file)
    assert in_force(zones) == [DOCK, YARD]
    write_later(file, "zones: [{name: dock}]", 2)
    for _ in range(3):
        await zones.look(file)
    assert "corners: is missing" in zones.problem
    assert zones.problem.endswith("the zones stay as they were")
    assert in_force(zones) == [DOCK, YARD]
    with pytest.raises(ZoneFileError, match="mend the file first"):
        await zones.remove(YARD, by="ada")
    os.remove(file)  # noqa: PTH107 - the method blocks
    await zones.look(file)
    assert "No such file" in zones.problem
    write_later(file, "zones: []", 3)
    for _ in range(2):
        await zones.look(file)
    assert (zones.problem, in_force(zones)) == ("", [])


async def test_a_change_is_noticed_by_itself(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zone_file, "LOOK_S", 0.02)
    zones = await loaded(file)
    watching = asyncio.create_task(zones.watch())
    write_later(file, text_of([YARD]), 1)
    async with asyncio.timeout(30):
        while in_force(zones) != [YARD]:  # noqa: ASYNC110 - nobody tells
            await asyncio.sleep(0.01)
    watching.cancel()


async def test_zones_are_drawn_changed_and_removed(file: Path) -> None:
    os.chmod(file, 0o640)  # noqa: PTH101 - the method blocks
    zones = await loaded(file)
    await zones.draw(YARD, by="ada")
    assert in_force(zones) == list(load_zones(file)) == [DOCK, YARD]
    larger = zone_of("the yard", "on", [(-2, 0), (0, 0), (0, 3)])
    await zones.draw(larger, instead_of=YARD, by="ada")
    assert in_force(zones) == list(load_zones(file)) == [DOCK, larger]
    await zones.remove(DOCK, by="ada")
    assert in_force(zones) == list(load_zones(file)) == [larger]
    assert mode_of(file) == 0o640
    await zones.look(file)
    await zones.look(file)
    assert (in_force(zones), zones.problem) == ([larger], "")
    assert names_in(file.parent) == [file.name]


async def test_what_may_not_be_is_refused_and_nothing_is_written(file: Path) -> None:
    zones, before = await loaded(file), text_in(file)
    with pytest.raises(ZoneFileError, match="two zones of site hall are called 'dock'"):
        await zones.draw(DOCK, by="ada")
    with pytest.raises(ZoneFileError, match="was changed meanwhile"):
        await zones.draw(DOCK, instead_of=YARD, by="ada")
    with pytest.raises(ZoneFileError, match="was changed meanwhile"):
        await zones.remove(YARD, by="ada")
    with pytest.raises(ZoneFileError, match=r"2 corners: a zone needs at least 3"):
        zone_of("short", "hall", [(0, 0), (1, 1)])
    with pytest.raises(ZoneFileError, match=r"^name: "):
        zone_of("", "hall", DOCK.corners)
    assert text_in(file) == before
    assert in_force(zones) == [DOCK]


async def test_what_somebody_edits_meanwhile_is_not_overwritten(file: Path) -> None:
    zones = await loaded(file)
    write_later(file, text_of([DOCK, zone_of("by hand", "hall", DOCK.corners)]), 1)
    with pytest.raises(ZoneFileError, match="was changed meanwhile; try again"):
        await zones.draw(YARD, by="ada")
    await zones.look(file)
    await zones.look(file)
    await zones.draw(YARD, by="ada")
    assert [each.name for each in load_zones(file)] == ["dock", "by hand", YARD.name]


async def test_what_could_not_be_read_is_not_written(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    zones, before = await loaded(file), text_in(file)
    with pytest.raises(ZoneFileError, match="give them other names"):
        await zones.draw(zone_of("two\u2028 lines", "hall", YARD.corners), by="ada")
    monkeypatch.setattr(zones_module, "MAX_CHARACTERS", len(before) + 9)
    with pytest.raises(ZoneFileError, match="at most"):
        await zones.draw(YARD, by="ada")
    assert (in_force(zones), text_in(file)) == ([DOCK], before)


async def test_there_may_be_so_many(file: Path) -> None:
    write_later(file, text_of([zone_of(f"z{n}", "hall", DOCK.corners) for n in range(MAX_ZONES)]), 1)
    zones = await loaded(file)
    with pytest.raises(ZoneFileError, match=f"{MAX_ZONES + 1} are given; there may be {MAX_ZONES} at most"):
        await zones.draw(DOCK, by="ada")


async def test_without_a_file_nothing_is_drawn() -> None:
    zones = await loaded(None)
    assert not zones.is_there
    with pytest.raises(ZoneFileError, match="start the monitor with --zones"):
        await zones.draw(DOCK, by="ada")


async def test_a_file_that_cannot_be_written_is_said(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    zones = await loaded(file)
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ZoneFileError, match=r"cannot be written: No space left on device"):
        await zones.draw(YARD, by="ada")
    assert in_force(zones) == list(load_zones(file)) == [DOCK]
    assert names_in(file.parent) == [file.name]
