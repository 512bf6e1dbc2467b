"""Drives through held-out scenes, as a robot's camera sees them, and which object is where in each frame."""

import hashlib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from schemas.detections import Mask
from services.simulator.training.dataset import holdout_seed
from services.simulator.training.evaluation.keeping import kept
from services.simulator.training.evaluation.precision import MIN_AREA
from services.simulator.training.evaluation.scenes import Picture, generator_digest, png_of
from services.simulator.training.evaluation.truths import MIN_VISIBILITY, mask_of
from services.simulator.training.progress import Progress
from services.simulator.world import Camera, Drive, SeenObject, Sensor, expose, generate, render, truth_of

FIRST: Final = 200_000
"""The number, among a run's held-out scenes, of the first that is driven through here alone."""

HZ: Final = 5.0
METRES_PER_SECOND: Final = 1.0
"""What the simulated robots drive at, unless told otherwise: a round of about 60 m in 60 s."""


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """One visible object. identity: the same in every frame of a drive. asked_for: as an average precision's are."""

    identity: int
    name: str
    mask: Mask
    asked_for: bool


class DriveFrame(Picture, frozen=True, kw_only=True):
    """A picture and every object of which at least a pixel is visible."""

    seen: list[Seen]


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
    digest = hashlib.sha256(generator_digest().encode() + Path(__file__).read_bytes()).hexdigest()
    draw = partial(drawn, count=frames)
    return kept(folder / f"drives-{digest[:12]}-{frames}", seeds, draw, HeldOutDrive, workers=workers, report=report)


def drawn(seed: int, count: int) -> HeldOutDrive:
    """Render a drive through the scene of `seed` with one camera, whose faults are drawn at random."""
    scene, camera, rng = generate(seed), Camera(), np.random.default_rng([seed, 5])
    drive, sensor = Drive.plan(scene), Sensor.draw(rng)
    frames = []
    for number in range(count):
        pose = drive.pose(number * METRES_PER_SECOND / HZ / drive.length)
        rendering = render(scene, pose, camera)
        image = expose(rendering.color, sensor, rng)
        seen = [_seen(each) for each in truth_of(scene, rendering, pose, camera)]
        frames.append(DriveFrame(png=png_of(image), seen=seen))
    return HeldOutDrive(seed=seed, frames=frames)


def _seen(found: SeenObject) -> Seen:
    return Seen(
        identity=found.instance,
        name=found.name,
        mask=mask_of(found),
        asked_for=found.image_share >= MIN_AREA and found.visibility >= MIN_VISIBILITY,
    )
