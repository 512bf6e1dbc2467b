"""Shows clouds in a window as they arrive, or writes them to files."""

import asyncio
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, Protocol

from bus import LATEST, Bus, Subscription, open_bus
from gateway.ros1.tasks import to_the_end
from schemas import codec, keys
from schemas.errors import SchemaError
from schemas.keys import CameraKey, Stream
from schemas.objects import ObjectClouds
from schemas.printing import printable
from services.toolbox.clouds.drawing import Drawing, drawing_of
from services.toolbox.clouds.files import pcd, ply
from services.toolbox.clouds.settings import CloudsSettings
from services.toolbox.clouds.viewing import CloudWindow
from services.toolbox.errors import ViewerError

FAILED: Final = 1
FRAME_S: Final = 1 / 30
GATHER_S: Final = 0.5
"""Seconds without a message after which the existing cameras are looked up."""

NEEDED: Final = "a cloud worker and a detector must be running"
WRITERS: Final = {"ply": ply, "pcd": pcd}


class Shown(Protocol):
    """The interface of a window for clouds."""

    def show(self, drawing: Drawing) -> None: ...

    def turn(self) -> bool: ...


async def run(settings: CloudsSettings) -> int:
    """View or save; return the exit code.

    Raises:
        ViewerError: no window can be opened, or no file written.
        ModuleNotFoundError: Open3D is needed and not installed.
    """
    if settings.do == "save":
        async with open_bus(settings) as bus:
            return await save(bus, settings)
    with _window(f"fleetsight: {settings.key}") as window:
        async with open_bus(settings) as bus:
            await view(bus, settings, window)
    return 0


async def save(bus: Bus, settings: CloudsSettings) -> int:
    """Write the next messages with points to files, and print their names; return the exit code.

    Objects in view before the first subscription have no points: gateways send points only on demand.
    """
    async with bus.subscribe(settings.key.stream(Stream.OBJECTS), LATEST, history=False) as samples:
        for _ in range(settings.count):
            empty = ""
            try:
                async with asyncio.timeout(settings.timeout_s):
                    while not (seen := await _next(samples, settings)).objects:
                        empty = ", ".join(_remarks(seen))
            except TimeoutError:
                where = f"clouds of {settings.key} in {settings.timeout_s:g} s"
                reason = empty or bus.link_problem or _absence(settings.key, await _cameras(bus)) or NEEDED
                sys.stderr.write(f"fleetsight clouds: no {where}; {printable(reason)}\n")
                return FAILED
            for path in await to_the_end(asyncio.to_thread(_write, seen, settings)):
                sys.stdout.write(f"{path}: {sum(each.count for each in seen.objects)} points\n")
            for remark in _remarks(seen):
                sys.stderr.write(f"fleetsight clouds: {printable(remark)}\n")
    return 0


async def view(bus: Bus, settings: CloudsSettings, window: Shown) -> None:
    """Show clouds until the window is closed."""

    async def receive() -> None:
        async with bus.subscribe(settings.key.stream(Stream.OBJECTS), LATEST, history=False) as samples:
            while True:
                window.show(drawing_of(await _next(samples, settings)))

    async with asyncio.TaskGroup() as group:
        receiving = group.create_task(receive())
        while window.turn():  # noqa: ASYNC110 - a window is to be looked after often, whether there is news or not
            await asyncio.sleep(FRAME_S)
        receiving.cancel()


async def _next(samples: Subscription, settings: CloudsSettings) -> ObjectClouds:
    """Wait for the next valid message."""
    while True:
        sample = await anext(samples)
        try:
            seen = codec.decode(ObjectClouds, sample.payload, sample.encoding)
            codec.check_identity(seen.header, settings.key)
        except SchemaError as error:
            sys.stderr.write(f"fleetsight clouds: message skipped: {printable(str(error))}\n")
            continue
        return seen


async def _cameras(bus: Bus) -> list[CameraKey]:
    """Return the cameras that are published now, by robot and name."""
    present: set[CameraKey] = set()
    async with bus.watch(keys.every_stream_alive(Stream.COLOR)) as watch:
        with suppress(TimeoutError):
            async with asyncio.timeout(GATHER_S):
                async for presence in watch:
                    with suppress(SchemaError):
                        present.add(keys.parse_stream(presence.key).camera)
    return sorted(present)


def _absence(wanted: CameraKey, present: Sequence[CameraKey]) -> str:
    """Return that there is no such camera, or an empty string."""
    if wanted in present:
        return ""
    robot, own = wanted.robot, ", ".join(key.camera for key in present if key.robot == wanted.robot)
    return f"{robot} has no camera {wanted.camera}, but {own}" if own else f"{robot} has no camera online"


def _remarks(seen: ObjectClouds) -> Iterator[str]:
    """Yield why there are fewer points than expected."""
    if not seen.objects and not seen.unmeasured:
        yield "no object of the detector's classes was in view"
    for reason, count in Counter(seen.unmeasured.values()).items():
        yield f"{count} {'object has' if count == 1 else 'objects have'} no points: {reason}"


def _write(seen: ObjectClouds, settings: CloudsSettings) -> list[Path]:
    stem = f"{settings.robot}_{settings.camera}_{seen.header.stamp_ns}_{seen.header.seq}"
    paths = [settings.folder / f"{stem}.{kind}" for kind in settings.formats]
    try:
        settings.folder.mkdir(parents=True, exist_ok=True)
        for path, kind in zip(paths, settings.formats, strict=True):
            path.write_bytes(WRITERS[kind](seen))
    except OSError as error:
        raise ViewerError(f"--folder {settings.folder}: {error.strerror or error}") from error
    return paths


@contextmanager
def _window(title: str) -> Iterator[CloudWindow]:
    window = CloudWindow(title)
    try:
        yield window
    finally:
        window.close()
