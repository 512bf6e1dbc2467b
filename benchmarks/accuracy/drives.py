"""Drives through held-out scenes, as simulated robots publish them, and which object is where in each frame."""

import hashlib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.detections import Mask
from services.simulator import film
from services.simulator.film import Film, Part, Store
from services.simulator.fleet import equipment
from services.simulator.placement import COLOR_OPTICAL, Placement
from services.simulator.settings import SimulatorSettings
from services.simulator.world import Drive, SeenObject, generate, render, truth_of
from services.training.dataset import holdout_seed
from services.training.evaluation.precision import MIN_AREA
from services.training.evaluation.scenes import Picture, generator_digest, png_of
from services.training.evaluation.truths import MIN_VISIBILITY, mask_of
from services.training.files import kept
from services.training.parallel import Progress

FIRST: Final = 200_000
"""The number, among a run's held-out scenes, of the first that is driven through here alone."""

HZ: Final = 5.0
METRES_PER_SECOND: Final = 1.0
"""What the simulated robots drive at, unless told otherwise: a round of about 60 m in 60 s."""


SENSORS: Final = equipment(SimulatorSettings(ros_master=None))
"""What simulated robots have, unless told otherwise."""


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """One visible object. identity: the same in every frame of a drive. asked_for: as an average precision's are."""

    identity: int
    name: str
    mask: Mask
    asked_for: bool


class DriveFrame(Picture, frozen=True, kw_only=True):
    """A picture and every object of which at least a pixel is visible.

    depth_png: the depth image, uint16 in millimetres. pose: of the colour camera's optical frame in the map, 4 x 4.
    """

    seen: list[Seen]
    depth_png: bytes
    pose: list[list[float]]


class HeldOutDrive(msgspec.Struct, frozen=True, kw_only=True):
    """The first frames of a drive through the scene of `seed`, `HZ` a second."""

    seed: int
    frames: list[DriveFrame]


def drive_seeds(seed: int, count: int) -> list[int]:
    """The scenes to drive through: no run of whatever seed trains on them."""
    return [holdout_seed(seed, FIRST + index) for index in range(count)]


def held_out_drives(
    folder: Path, seeds: Sequence[int], frames: int, workers: int, report: Progress
) -> Iterator[HeldOutDrive]:
    """Yield the first `frames` of the drive through each scene, rendered once; see `kept`."""
    sources = (Path(str(path)).read_bytes() for path in (__file__, film.__file__, film.__file__))
    decisive = f"{generator_digest()} {SENSORS}".encode() + b"".join(sources)
    digest = hashlib.sha256(decisive).hexdigest()
    draw = partial(drawn, count=frames)
    return kept(folder / f"drives-{digest[:12]}-{frames}", seeds, draw, HeldOutDrive, workers=workers, report=report)


def drawn(seed: int, count: int) -> HeldOutDrive:
    """Film a drive through the scene of `seed` with a simulated robot's colour camera."""
    scene = generate(seed)
    drive = Drive.plan(scene)
    instants = max(1, round(drive.length / METRES_PER_SECOND * HZ))
    filmed = Film(seed, SENSORS, instants, HZ, Store(limit=0))
    frames = []
    for number in range(count):
        measured = filmed.measure(number, [Part.COLOR, Part.DEPTH])
        pose = drive.pose(filmed.fraction(number))
        seen = [seen_of(each) for each in truth_of(scene, render(scene, pose, SENSORS.color), pose, SENSORS.color)]
        frames.append(
            DriveFrame(
                png=png_of(measured[Part.COLOR]),
                seen=seen,
                depth_png=depth_png_of(measured[Part.DEPTH]),
                pose=optical_of(filmed, number).tolist(),
            )
        )
    return HeldOutDrive(seed=seed, frames=frames)


def optical_of(filmed: Film, number: int) -> Placement:
    """Return where the colour camera's optical frame is in the map in an image of a film."""
    return filmed.robot(number) @ filmed.rig.on_robot(COLOR_OPTICAL)


def depth_png_of(depth: NDArray[np.uint16]) -> bytes:
    """The PNG of a depth image in millimetres."""
    _, png = cv2.imencode(".png", np.ascontiguousarray(depth), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return png.tobytes()


def seen_of(found: SeenObject) -> Seen:
    """Return a visible object as it is compared with detections."""
    return Seen(
        identity=found.instance,
        name=found.name,
        mask=mask_of(found),
        asked_for=found.image_share >= MIN_AREA and found.visibility >= MIN_VISIBILITY,
    )
