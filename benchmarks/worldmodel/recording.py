"""Rounds through a warehouse as a robot sees them: detections, depth images, exact poses, and what truly is there.

A round is recorded once, with a detector's own inference, and kept in a folder: what localisation makes of it, and the
distance service, is worked out each time.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.drives import METRES_PER_SECOND, SENSORS, seen_of
from benchmarks.accuracy.following import LEAST_IOU, mask_overlap
from schemas.detections import Detection, Detections
from schemas.header import Header
from services.simulator.film import Film, Part, Store
from services.simulator.placement import COLOR_OPTICAL, Placement, to_pose
from services.simulator.world import Drive, Scene, SeenObject, generate, render_geometry, truth_of
from services.training.evaluation.predictor import Predictor
from services.training.files import write_whole

CAMERA: Final = "camera"
NOTHING: Final = 0
"""Stands for no object."""


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

    shown: which object each detection shows, NOTHING where its mask lies on none.
    """

    detections: Detections
    depth_png: bytes
    pose: list[list[float]]
    visible: list[VisibleObject]
    shown: list[int]

    def depth(self) -> NDArray[np.uint16]:
        """Return the depth image, (height, width) millimetres, 0 for no reading."""
        return np.asarray(cv2.imdecode(np.frombuffer(self.depth_png, np.uint8), cv2.IMREAD_UNCHANGED), np.uint16)


class RecordedRound(msgspec.Struct, frozen=True, kw_only=True):
    """One robot's round, hz images a second, and every object of the warehouse that is visible on it."""

    robot: str
    hz: float
    images: list[RecordedImage]
    objects: list[TrueObject]


@dataclass(frozen=True, slots=True)
class Recorder:
    """Records rounds, hz images a second, and keeps them in a folder.

    digest: of all that decides what is recorded: the weights, the generator.
    """

    folder: Path
    hz: float
    predict: Predictor
    digest: str

    def round(self, seed: int, number: int) -> RecordedRound:
        """Return round `number` through the warehouse of `seed`, from the folder if it is there."""
        file = self.folder / f"{self.digest[:16]}-{seed}-{number}-{self.hz:g}.msgpack"
        if file.exists():
            return msgspec.msgpack.decode(file.read_bytes(), type=RecordedRound)
        made = record(seed, number, self.hz, self.predict)
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(file, msgspec.msgpack.encode(made))
        return made


def record(seed: int, number: int, hz: float, predict: Predictor) -> RecordedRound:
    """Drive round `number` through the warehouse of `seed` at METRES_PER_SECOND and detect what is in each image."""
    scene = generate(seed)
    count = max(1, round(Drive.plan(scene, number).length / METRES_PER_SECOND * hz))
    film = Film(seed, SENSORS, count, hz, Store(limit=0), round=number)
    robot = f"r{number + 1}"
    objects: dict[int, TrueObject] = {}
    images = []
    for index in range(count):
        placement = film.robot(index) @ film.rig.on_robot(COLOR_OPTICAL)
        seen = visible_in(scene, placement)
        objects.update((each.instance, _true(each)) for each in seen if each.instance not in objects)
        measured = film.measure(index, [Part.COLOR, Part.DEPTH])
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
        _, png = cv2.imencode(".png", np.ascontiguousarray(measured[Part.DEPTH]), [cv2.IMWRITE_PNG_COMPRESSION, 1])
        images.append(
            RecordedImage(
                detections=Detections(
                    header=header,
                    height=SENSORS.color.height,
                    width=SENSORS.color.width,
                    objects=found,
                    model="",
                    worker="recorder",
                ),
                depth_png=png.tobytes(),
                pose=placement.tolist(),
                visible=[VisibleObject(each.instance, each.image_share, each.visibility) for each in seen],
                shown=shown_by(found, seen),
            )
        )
    return RecordedRound(robot=robot, hz=hz, images=images, objects=[objects[key] for key in sorted(objects)])


def visible_in(scene: Scene, placement: Placement) -> tuple[SeenObject, ...]:
    """Return what a camera at a placement of its optical frame sees."""
    pose, camera = to_pose(placement), SENSORS.color
    return truth_of(scene, render_geometry(scene, pose, camera), pose, camera)


def shown_by(found: list[Detection], seen: tuple[SeenObject, ...]) -> list[int]:
    """Return the number of the object that each detection's mask lies on best, NOTHING below LEAST_IOU."""
    if not seen:
        return [NOTHING] * len(found)
    overlap = mask_overlap([seen_of(each) for each in seen], found)
    return [
        seen[best].instance if overlap[best, column] >= LEAST_IOU else NOTHING
        for column, best in enumerate(overlap.argmax(axis=0).tolist())
    ]


def _true(seen: SeenObject) -> TrueObject:
    x, y, z = seen.box.centre.tolist()
    length, width, height = seen.box.size.tolist()
    return TrueObject(instance=seen.instance, name=seen.name, centre=(x, y, z), size=(length, width, height))
