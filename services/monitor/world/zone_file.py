"""The zone file: read again when it changes, and written when an operator draws."""

import asyncio
import json
import logging
import os
import shutil
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final

from services.monitor.file_version import FileVersion
from services.monitor.world.site_objects import World
from services.monitor.world.zones import Zone, ZoneFileError, check_zones, load_zones, parse_zones

LOOK_S: Final = 0.5

NO_FILE: Final = "zones are kept in a file: start the monitor with --zones zones.yaml, which may say just `zones: []`"

_HEAD: Final = "# Zones of the warehouse. Written by the monitor when somebody draws; comments are not kept then.\n"

log = logging.getLogger(__name__)


class ZoneFile:
    """The zones of a file, which are those of a world; a mistake leaves them as they are.

    problem: why the newest version is not in force, in words, or empty.
    """

    def __init__(self, path: Path | None, world: World) -> None:
        self.problem = ""
        self._path = path
        self._world = world
        self._version = FileVersion()
        self._writing = asyncio.Lock()

    @property
    def zones(self) -> tuple[Zone, ...]:
        """The zones in force, by site."""
        return tuple(zone for site in self._world.sites.values() for zone in site.zones)

    @property
    def is_there(self) -> bool:
        """Whether there is a file that zones can be drawn into."""
        return self._path is not None

    async def load(self) -> None:
        """Read the file for the first time.

        Raises:
            ZoneFileError: it cannot be used.
        """
        if self._path is not None:
            await self._take_new(self._path, settled=False)

    async def watch(self) -> None:
        """Keep the world's zones up to date until cancelled."""
        while self._path is not None:
            await asyncio.sleep(LOOK_S)
            await self.look(self._path)

    async def look(self, path: Path) -> None:
        """Read the file if it changed and then stayed the same for one look: it may be half written."""
        async with self._writing:
            try:
                await self._take_new(path, settled=True)
            except ZoneFileError as error:
                problem = f"{error}; the zones stay as they were"
                if problem != self.problem:
                    log.error("%s", problem)  # noqa: TRY400 - it is no fault of ours
                self.problem = problem

    async def draw(self, zone: Zone, *, instead_of: Zone | None = None, by: str) -> None:
        """Add a zone, or put it in the place of one; write the file. by: a user's name.

        Raises:
            ZoneFileError: there may be no such zone, that one is not there any more, or the file cannot be written.
        """
        async with self._writing:
            zones = list(self.zones)
            if instead_of is None:
                zones.append(zone)
            else:
                zones[_place_of(instead_of, zones)] = zone
            await self._write(check_zones(zones))
        log.info("%s drew the zone %s of site %s", by, zone.name, zone.site)

    async def remove(self, zone: Zone, *, by: str) -> None:
        """Remove a zone; write the file. by: a user's name.

        Raises:
            ZoneFileError: it is not there any more, or the file cannot be written.
        """
        async with self._writing:
            zones = list(self.zones)
            del zones[_place_of(zone, zones)]
            await self._write(tuple(zones))
        log.info("%s removed the zone %s of site %s", by, zone.name, zone.site)

    async def _take_new(self, path: Path, *, settled: bool) -> None:
        zones = await asyncio.to_thread(self._read, path, settled=settled)
        if zones is not None:
            self._world.set_zones(zones)
            self.problem = ""
            log.info("%s: %d zones are in force", path, len(zones))

    def _read(self, path: Path, *, settled: bool) -> tuple[Zone, ...] | None:
        try:
            if not self._version.is_new(path, settled=settled):
                return None
        except OSError as error:
            self._version.forget()
            raise ZoneFileError(f"zones {path}: {error.strerror}") from error
        return load_zones(path)

    async def _write(self, zones: tuple[Zone, ...]) -> None:
        if self._path is None:
            raise ZoneFileError(NO_FILE)
        if self.problem:
            raise ZoneFileError(f"{self.problem}; mend the file first, as it would be overwritten")
        await asyncio.to_thread(self._replace, self._path, zones)
        self._world.set_zones(zones)

    def _replace(self, path: Path, zones: tuple[Zone, ...]) -> None:
        """Write the file, unless somebody else did since it was read."""
        text = text_of(zones)
        if parse_zones(text) != zones:
            raise ZoneFileError("these zones cannot be written; give them other names")
        try:
            if self._version.is_new(path, settled=False):
                self._version.forget()
                raise ZoneFileError(f"{path} was changed meanwhile; try again")
        except OSError as error:
            raise ZoneFileError(f"zones {path}: {error.strerror}") from error
        write_whole(path, text, self._version)


def text_of(zones: Iterable[Zone]) -> str:
    """Return a zone file's text."""
    lines = [
        f"  - {{name: {json.dumps(zone.name, ensure_ascii=False)}, site: {json.dumps(zone.site)},"
        f" corners: {json.dumps(zone.corners)}}}"
        for zone in zones
    ]
    return _HEAD + ("\n".join(["zones:", *lines]) if lines else "zones: []") + "\n"


def _place_of(zone: Zone, zones: list[Zone]) -> int:
    if zone not in zones:
        raise ZoneFileError(f"the zone {zone.name!r} was changed meanwhile; look at it again")
    return zones.index(zone)


def write_whole(path: Path, text: str, version: FileVersion) -> None:
    """Write a file whole or not at all, with the mode that it has. version: takes it as read."""
    path = path.resolve()
    draft = None
    try:
        with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=path.parent, delete=False) as file:
            draft = Path(file.name)
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        shutil.copymode(path, draft)
        version.take(draft)
        draft.replace(path)
    except OSError as error:
        if draft is not None:
            with suppress(OSError):
                draft.unlink()
        raise ZoneFileError(
            f"zones {path} cannot be written: {error.strerror}; let the monitor's user write in {path.parent}"
        ) from error
