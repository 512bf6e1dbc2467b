"""Watches class lists, takes a picture of a camera when a rule says so, and saves it."""

import asyncio
import logging
import sys
from asyncio import Event, Lock, Task, TaskGroup
from collections import Counter
from collections.abc import Callable
from contextlib import AsyncExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Final

from bus import LATEST, QUEUE, Bus, RefusedError, Reply, Request, RequestError, Sample, Subscription, Watch, open_bus
from fleetsight.asking import ask_detectors
from fleetsight.listening import images_of
from fleetsight.patterns import chunk
from gateway.ros1.tasks import to_the_end
from schemas import codec, keys
from schemas.detections import ClassList, Detections
from schemas.errors import SchemaError
from schemas.header import MAX_LABEL
from schemas.image import ImageFrame
from schemas.keys import ALIVE, CameraKey, Stream
from schemas.models import PictureRequest, SavedPicture
from schemas.printing import printable
from services.toolbox.collect.dataset import Dataset
from services.toolbox.collect.pictures import Picture, blurred, picture_of
from services.toolbox.collect.rules import CameraRules, Rules
from services.toolbox.collect.settings import CollectSettings

FAILED: Final = 1
IMAGE_S: Final = 10.0
"""Seconds to wait for an image."""

ANSWER_S: Final = 10.0
"""Seconds to wait for a detector worker's answer."""

AT_ONCE: Final = 4
"""Pictures that somebody asked for and that are taken at the same time: one that does not come delays no others."""

log = logging.getLogger(__name__)


class _NotSavedError(Exception):
    """A picture was not saved; the message says why."""


async def run(settings: CollectSettings) -> int:
    """Collect until a limit is reached or the process is told to end; return the exit code: 1 if nothing was saved.

    Raises:
        DatasetError: the folder cannot be used.
        BusError: the fleet cannot be joined.
    """
    dataset = await asyncio.to_thread(Dataset.open, settings.folder, settings.names)
    collecting = Collecting(settings, dataset)
    try:
        async with open_bus(settings) as bus:
            await collecting.run(bus)
    finally:
        sys.stdout.write(f"{collecting.summary}\n")
    return 0 if collecting.counts[SAVED] else FAILED


SAVED: Final = "saved"


class Collecting:
    """One run. counts: of pictures, by what became of them."""

    def __init__(self, settings: CollectSettings, dataset: Dataset) -> None:
        self._settings = settings
        self._dataset = dataset
        self._rules = Rules(settings.unsure_span, frozenset(settings.appears), settings.disagree)
        self._cameras: dict[CameraKey, _Camera] = {}
        self._full = Event()
        self._saving = Lock()
        self.counts: Counter[str] = Counter()

    @property
    def summary(self) -> str:
        """The numbers of saved and unsaved pictures, in a line."""
        many = "picture" if self.counts[SAVED] == 1 else "pictures"
        saved = f"{self.counts[SAVED]} {many} saved in {printable(str(self._dataset.folder))}"
        others = (f"{count} {reason}" for reason, count in self.counts.most_common() if reason != SAVED)
        return ", ".join([saved, *others])

    async def run(self, bus: Bus) -> None:
        """Collect until a limit is reached or cancelled."""
        self._note_size()
        where = f"fleet/{chunk('robots', self._settings.robots)}/{chunk('cameras', self._settings.cameras)}"
        async with (
            bus.watch(f"{where}/{Stream.COLOR}/{ALIVE}") as present,
            TaskGroup() as group,
            AsyncExitStack() as stack,
        ):
            running = [group.create_task(self._watch(present, bus, group))]
            if self._settings.unsure or self._settings.appears or self._settings.disagree:
                running.append(group.create_task(self._follow(bus, f"{where}/{Stream.CLASSES}")))
            if self._settings.disagree:
                running.append(group.create_task(self._follow(bus, f"{where}/{Stream.OPINION}")))
            if self._settings.asked:
                await stack.enter_async_context(bus.serve(keys.COLLECT, partial(self._answer, bus), at_once=AT_ONCE))
            try:
                async with asyncio.timeout(self._settings.seconds):
                    await self._full.wait()
            except TimeoutError:
                pass
            for task in [*running, *(camera.task for camera in self._cameras.values() if camera.task)]:
                task.cancel()

    async def _watch(self, present: Watch, bus: Bus, group: TaskGroup) -> None:
        async for presence in present:
            try:
                key = keys.parse_stream(presence.key).camera
            except SchemaError as error:
                log.warning("%s: left out: %s", presence.key[:200], error)
                continue
            if presence.alive and key not in self._cameras:
                camera = self._cameras[key] = _Camera(CameraRules(self._rules))
                camera.task = group.create_task(self._serve(bus, key, camera))
            elif not presence.alive and (gone := self._cameras.pop(key, None)) is not None and gone.task is not None:
                gone.task.cancel()

    async def _follow(self, bus: Bus, key: str) -> None:
        async with bus.subscribe(key, QUEUE(1_000, 64 << 20)) as lists:
            async for sample in lists:
                self._look(sample)

    def _look(self, sample: Sample) -> None:
        try:
            key = keys.parse_stream(sample.key)
            seen = codec.decode(ClassList, sample.payload, sample.encoding)
            codec.check_identity(seen.header, key.camera)
        except SchemaError as error:
            log.warning("%s: left out: %s", sample.key[:200], error)
            return
        camera = self._cameras.get(key.camera)
        if camera is not None:
            rules = camera.rules
            camera.ask(rules.seen(seen) if key.stream == Stream.CLASSES else rules.opinion(seen))

    async def _serve(self, bus: Bus, key: CameraKey, camera: "_Camera") -> None:
        """Take pictures of a camera when there is a reason, with a rest after each."""
        while True:
            why = await camera.reason(self._settings.every_s, self._settings.rest_s)
            with suppress(_NotSavedError):
                await self._take(bus, key, why, self._settings.least_difference)
            await asyncio.sleep(self._settings.rest_s)
            camera.forget()

    async def _answer(self, bus: Bus, request: Request) -> Reply:
        """Save the picture that somebody asks for, whatever it looks like."""
        try:
            asked = codec.decode(PictureRequest, request.payload, request.encoding)
        except SchemaError as error:
            raise RefusedError(str(error)) from error
        key = CameraKey(asked.robot, asked.camera)
        if key not in self._cameras:
            raise RefusedError(f"{key} is not online, or not among the cameras that are collected from")
        try:
            by = printable(asked.by) or "somebody"
            file, found = await self._take(bus, key, f"asked for by {by}", least_difference=0)
        except _NotSavedError as error:
            raise RefusedError(str(error)) from error
        folder = self._dataset.folder
        saved = SavedPicture(
            file=printable(str(file.relative_to(folder)))[:MAX_LABEL],
            folder=printable(str(folder.resolve()))[:MAX_LABEL],
            objects=None if found is None else sum(each.name not in self._settings.blur for each in found.objects),
        )
        return Reply(codec.encode(saved), codec.encoding(SavedPicture))

    async def _take(self, bus: Bus, key: CameraKey, why: str, least_difference: int) -> tuple[Path, Detections | None]:
        """Save a picture of a camera; return its file, and its drafts if it has any.

        Raises:
            _NotSavedError: it was not saved; that is counted and logged.
        """
        try:
            async with asyncio.timeout(IMAGE_S), images_of(bus, key, LATEST) as frames:
                picture = await asyncio.to_thread(picture_of, await _image(frames, key))
        except TimeoutError:
            raise self._lost(key, "without an image", f"no image within {IMAGE_S:g} s") from None
        except ValueError as error:
            raise self._lost(key, "damaged", f"{error}") from error
        if self._dataset.is_known(key, picture.fingerprint, least_difference):
            self.counts["like others"] += 1
            raise _NotSavedError("it looks like one that was saved")
        found = None
        if self._settings.drafts or self._settings.blur:
            try:
                found = await ask_detectors(bus, picture.file, ANSWER_S)
            except (RequestError, SchemaError) as error:  # without labels it would say that there is nothing to see
                raise self._lost(key, "without an answer of a detector worker", f"not saved: {error}") from error
        return await self._save(key, picture, why, found)

    async def _save(
        self, key: CameraKey, picture: Picture, why: str, found: Detections | None
    ) -> tuple[Path, Detections | None]:
        hidden = tuple(self._settings.blur)
        if found is not None and hidden:
            picture = await asyncio.to_thread(blurred, picture, found.objects, hidden)
        drafts = found if self._settings.drafts else None
        try:
            async with self._saving:
                if self._full.is_set():
                    raise _NotSavedError("the folder has as many pictures as it is to have (--most, --most-mb)")
                save = partial(self._dataset.save, picture, why, drafts, self._settings.split, hidden)
                return await to_the_end(self._write(save, why)), drafts
        except OSError as error:
            raise self._lost(key, "not written", f"{error.filename}: {error.strerror}") from error

    async def _write(self, save: Callable[[], Path], why: str) -> Path:
        file = await asyncio.to_thread(save)
        self.counts[SAVED] += 1
        log.info("%s: %s", file, why)
        self._note_size()
        return file

    def _lost(self, key: CameraKey, reason: str, error: str) -> "_NotSavedError":
        self.counts[reason] += 1
        log.warning("%s: %s", key, printable(error))
        return _NotSavedError(f"{key}: {printable(error)}")

    def _note_size(self) -> None:
        if self._dataset.count >= self._settings.most or self._dataset.size >= self._settings.most_mb * 1e6:
            self._full.set()


class _Camera:
    """A camera that is there: its rules, and the reason for the next picture."""

    def __init__(self, rules: CameraRules) -> None:
        self.rules = rules
        self.task: Task[None] | None = None
        self._why: str | None = None
        self._asked = Event()

    def ask(self, why: str | None) -> None:
        if why is not None and self._why is None:
            self._why = why
            self._asked.set()

    def forget(self) -> None:
        """Forget what was asked for during the rest: the view may be another one by now."""
        self._why = None
        self._asked.clear()

    async def reason(self, every_s: float | None, rested_s: float) -> str:
        """Wait for a reason: one of the rules, or that the time is up. rested_s: how much of it is over already."""
        try:
            async with asyncio.timeout(None if every_s is None else max(0, every_s - rested_s)):
                await self._asked.wait()
        except TimeoutError:
            return f"every {every_s:g} s"
        return self._why or ""


async def _image(frames: Subscription, key: CameraKey) -> ImageFrame:
    async for sample in frames:
        try:
            frame = codec.decode(ImageFrame, sample.payload, sample.encoding)
            codec.check_identity(frame.header, key)
        except SchemaError as error:
            log.warning("%s: left out: %s", sample.key, error)
        else:
            return frame
    raise TimeoutError
