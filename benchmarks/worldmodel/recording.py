"""Drives through a warehouse as robots see it: detections, depth images, exact poses, and what truly is there.

A drive is recorded once, with a detector's own inference, and kept in a folder: what localisation makes of it, and the
distance service, is worked out each time.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.drives import METRES_PER_SECOND, SENSORS, depth_png_of, optical_of, seen_of
from benchmarks.accuracy.following import LEAST_IOU, mask_overlap
from schemas.detections import Detection, Detections
from schemas.header import Header
from services.simulator.film import Film, Part, Store
from services.simulator.placement import COLOR_OPTICAL, Placement, to_pose
from services.simulator.world import (
    ChangingWorld,
    Drive,
    PresentObject,
    Scene,
    SeenObject,
    Travel,
    generate,
    present_in,
    render_geometry,
    truth_of,
)
from services.simulator.world.cuboids import Frame
from services.training.evaluation.predictor import Predictor
from services.training.files import keep_file

CAMERA: Final = "camera"
NOTHING: Final = 0
"""Stands for no object."""

LEAST_SHARE: Final = 0.001
"""Share of an image's pixels from which on an object is recorded as visible."""

CHANGES_PER_MINUTE: Final = 20.0
LEFT_M: Final = {"forklift": 2.0}
LEFT_ELSE_M: Final = 1.0
"""How far something must be from its place to have left it, by class."""

BEHIND_M: Final = 10.0
BEHIND_SHARE: Final = 0.75
"""What left its place is missing where so much of what is behind it is as near as a depth camera sees."""


class VisibleObject(msgspec.Struct, frozen=True, array_like=True):
    """An object in an image: its number in the scene, its share of the image's pixels, and how much of it is shown."""

    instance: int
    image_share: float
    visibility: float


class TrueObject(msgspec.Struct, frozen=True, kw_only=True):
    """An object of the scene: its number, class, and the centre and size of the upright box around it, in metres."""

    instance: int
    name: str
    centre: tuple[float, float, float]
    size: tuple[float, float, float]


class RecordedImage(msgspec.Struct, frozen=True, kw_only=True):
    """One image. depth_png: 16 bits, millimetres. pose: 4 x 4, of the optical frame in the map, exact.

    shown: which object each detection shows, NOTHING where its mask lies on none. second: when it was taken, of a world
    that changes. missing: objects that would be visible if they had not left their place, see BEHIND_SHARE.
    """

    detections: Detections
    depth_png: bytes
    pose: list[list[float]]
    visible: list[VisibleObject]
    shown: list[int]
    second: float = 0.0
    missing: list[VisibleObject] = []

    def depth(self) -> NDArray[np.uint16]:
        """Return the depth image, (height, width) millimetres, 0 for no reading."""
        return np.asarray(cv2.imdecode(np.frombuffer(self.depth_png, np.uint8), cv2.IMREAD_UNCHANGED), np.uint16)


class RecordedRound(msgspec.Struct, frozen=True, kw_only=True):
    """One robot's round, hz images a second, and every object of the warehouse that is visible on it."""

    robot: str
    hz: float
    images: list[RecordedImage]
    objects: list[TrueObject]


class ObjectChange(msgspec.Struct, frozen=True, kw_only=True):
    """An object's change in seconds since the start: where it was before, and is after it; None for away."""

    instance: int
    name: str
    kind: str
    begins_s: float
    ends_s: float
    before: tuple[float, float, float] | None
    after: tuple[float, float, float] | None


class RecordedChanges(msgspec.Struct, frozen=True, kw_only=True):
    """Robots' drives through a warehouse that changes, images in the order of time, and its objects at the start.

    start: the number of each round's image that the drive goes on from.
    """

    hz: float
    start: int
    images: list[RecordedImage]
    objects: list[TrueObject]
    changes: list[ObjectChange]


Recorded = TypeVar("Recorded", RecordedRound, RecordedChanges)


@dataclass(frozen=True, slots=True)
class Recorder:
    """Records drives, hz images a second, and keeps them in a folder.

    digest: of all that decides what is recorded: the weights, the generator.
    """

    folder: Path
    hz: float
    predict: Predictor
    digest: str

    def round(self, seed: int, number: int) -> RecordedRound:
        """Return round `number` through the warehouse of `seed`, from the folder if it is there."""
        made = partial(record, seed, number, self.hz, self.predict)
        return self._kept(f"{seed}-{number}", RecordedRound, made)

    def changes(self, seed: int, robots: int, start_s: float, seconds: float) -> RecordedChanges:
        """Return the first robots' drives through the warehouse as it changes, from so many seconds of theirs on."""
        made = partial(record_changes, seed, robots, self.hz, self.predict, start_s=start_s, seconds=seconds)
        return self._kept(f"{seed}-{robots}-changes-{start_s:g}-{seconds:g}", RecordedChanges, made)

    def _kept(self, name: str, kind: type[Recorded], make: Callable[[], Recorded]) -> Recorded:
        file = self.folder / f"{self.digest[:16]}-{name}-{self.hz:g}.msgpack"
        if file.exists():
            return msgspec.msgpack.decode(file.read_bytes(), type=kind)
        made = make()
        self.folder.mkdir(parents=True, exist_ok=True)
        keep_file(file, msgspec.msgpack.encode(made))
        return made


def record(seed: int, number: int, hz: float, predict: Predictor) -> RecordedRound:
    """Drive round `number` through the warehouse of `seed` at METRES_PER_SECOND and detect what is in each image."""
    scene = generate(seed)
    film = _film(seed, Drive.plan(scene, number), number, hz)
    robot = f"r{number + 1}"
    objects: dict[int, TrueObject] = {}
    images = []
    for index in range(film.frames):
        seen = visible_in(scene, optical_of(film, index))
        objects.update((each.instance, _true(each)) for each in seen if each.instance not in objects)
        images.append(_image(film, index, robot, seen, predict))
    return RecordedRound(robot=robot, hz=hz, images=images, objects=[objects[key] for key in sorted(objects)])


def record_changes(
    seed: int, robots: int, hz: float, predict: Predictor, *, start_s: float, seconds: float
) -> RecordedChanges:
    """Drive the first rounds through the warehouse of `seed` while it changes, from so many seconds of theirs on."""
    scene, start = generate(seed), round(start_s * hz)
    drives = [Drive.plan(scene, number) for number in range(robots)]
    counts = [_film(seed, drive, number, hz).frames for number, drive in enumerate(drives)]
    travels = [
        Travel(drive, count / hz, (start - number / robots) / count)
        for number, (drive, count) in enumerate(zip(drives, counts, strict=True))
    ]
    world = ChangingWorld(scene, CHANGES_PER_MINUTE, travels)
    films = [_film(seed, drive, number, hz, world) for number, drive in enumerate(drives)]
    images = []
    for step in range(round(seconds * hz)):
        for number, film in enumerate(films):
            second = (step + number / robots) / hz
            placement = optical_of(film, start + step)
            image = _image(
                film,
                start + step,
                f"r{number + 1}",
                visible_in(world.unpainted(second), placement),
                predict,
                second=second,
            )
            images.append(msgspec.structs.replace(image, missing=missing(world, second, placement)))
    return RecordedChanges(
        hz=hz,
        start=start,
        images=images,
        objects=[_true(each) for each in present_in(scene)],
        changes=list(object_changes(world, seconds)),
    )


def object_changes(world: ChangingWorld, seconds: float) -> Iterator[ObjectChange]:
    """Yield the changes of each object that begin within so many seconds."""
    scene = world.still
    for change in world.changes(seconds):
        before, after = (
            {each.instance: _centre(each) for each in world.objects(second)}
            for second in (float(np.nextafter(change.begins_s, 0)), change.ends_s)
        )
        for instance in scene.movables[change.movable].instances:
            yield ObjectChange(
                instance=instance,
                name=scene.class_name(instance),
                kind=change.kind,
                begins_s=change.begins_s,
                ends_s=change.ends_s,
                before=before.get(instance),
                after=after.get(instance),
            )


def missing(world: ChangingWorld, second: float, placement: Placement) -> list[VisibleObject]:
    """Return what would be visible where it was, had it not left its place with its last change; see BEHIND_SHARE."""
    back: dict[int, Frame | None] = {}
    for change in world.changes(second):
        number = change.movable
        before = world.places(float(np.nextafter(change.begins_s, 0))).get(number, world.still.movables[number].frame)
        back.pop(number, None)
        if before is not None and _has_left(world, number, before, change.place(second)):
            back[number] = before
    if not back:
        return []
    gone = {instance for number in back for instance in world.still.movables[number].instances}
    seen = visible_in(world.unpainted(second, back), placement)
    now = render_geometry(world.unpainted(second), to_pose(placement), SENSORS.color).depth
    near = (now > 0) & (now < BEHIND_M)
    return _visible([each for each in seen if each.instance in gone and near[each.full_mask()].mean() >= BEHIND_SHARE])


def _has_left(world: ChangingWorld, number: int, before: Frame, now: Frame | None) -> bool:
    far = LEFT_M.get(world.still.movables[number].name, LEFT_ELSE_M)
    return now is None or float(np.hypot(now.x - before.x, now.y - before.y)) > far


def _film(seed: int, drive: Drive, number: int, hz: float, world: ChangingWorld | None = None) -> Film:
    count = max(1, round(drive.length / METRES_PER_SECOND * hz))
    return Film(seed, SENSORS, count, hz, Store(limit=0), round=number, world=world)


def _image(
    film: Film,
    index: int,
    robot: str,
    seen: Sequence[SeenObject],
    predict: Predictor,
    *,
    second: float = 0.0,
) -> RecordedImage:
    measured = film.measure(index, [Part.COLOR, Part.DEPTH], second)
    found = list(predict(np.ascontiguousarray(measured[Part.COLOR])))
    header = Header(
        robot=robot,
        camera=CAMERA,
        boot_id="recorded",
        seq=index,
        stamp_ns=0,
        frame_id=COLOR_OPTICAL,
        received_ns=0,
    )
    return RecordedImage(
        detections=Detections(
            header=header,
            height=SENSORS.color.height,
            width=SENSORS.color.width,
            objects=found,
            model="",
            worker="recorder",
        ),
        depth_png=depth_png_of(measured[Part.DEPTH]),
        pose=optical_of(film, index).tolist(),
        visible=_visible(seen),
        shown=shown_by(found, seen),
        second=second,
    )


def _visible(seen: Sequence[SeenObject]) -> list[VisibleObject]:
    return [
        VisibleObject(each.instance, each.image_share, each.visibility)
        for each in seen
        if each.image_share >= LEAST_SHARE
    ]


def visible_in(scene: Scene, placement: Placement) -> tuple[SeenObject, ...]:
    """Return what a camera at a placement of its optical frame sees."""
    pose, camera = to_pose(placement), SENSORS.color
    return truth_of(scene, render_geometry(scene, pose, camera), pose, camera)


def shown_by(found: list[Detection], seen: Sequence[SeenObject]) -> list[int]:
    """Return the number of the object that each detection's mask lies on best, NOTHING below LEAST_IOU."""
    if not seen:
        return [NOTHING] * len(found)
    overlap = mask_overlap([seen_of(each) for each in seen], found)
    return [
        seen[best].instance if overlap[best, column] >= LEAST_IOU else NOTHING
        for column, best in enumerate(overlap.argmax(axis=0).tolist())
    ]


def _true(seen: SeenObject | PresentObject) -> TrueObject:
    length, width, height = seen.box.size.tolist()
    return TrueObject(instance=seen.instance, name=seen.name, centre=_centre(seen), size=(length, width, height))


def _centre(seen: SeenObject | PresentObject) -> tuple[float, float, float]:
    x, y, z = seen.box.centre.tolist()
    return x, y, z
