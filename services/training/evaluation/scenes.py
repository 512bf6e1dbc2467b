"""Held-out images and their ground truth: rendered once, kept in a folder."""

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from services.simulator import world
from services.simulator.world import Sensor, expose, generate
from services.simulator.world.clearance import Clearance
from services.training import viewpoints
from services.training.dataset import holdout_seed
from services.training.evaluation.truths import Truth, truths_of
from services.training.files import kept
from services.training.parallel import Progress
from services.training.viewpoints import draw_view

FIRST: Final = 100_000
"""The number, among a run's held-out scenes, of the first that is kept for the evaluation alone."""


class Picture(msgspec.Struct, frozen=True, kw_only=True):
    """A picture as a PNG."""

    png: bytes

    def image(self) -> NDArray[np.uint8]:
        """The picture, height x width x 3 in RGB."""
        return np.asarray(cv2.imdecode(np.frombuffer(self.png, np.uint8), cv2.IMREAD_COLOR), np.uint8)[..., ::-1]


def png_of(image: NDArray[np.uint8]) -> bytes:
    """The PNG of an RGB picture."""
    _, png = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return png.tobytes()


class HeldOutView(Picture, frozen=True, kw_only=True):
    """A picture of the scene of `seed` and every object of which at least a pixel is visible."""

    seed: int
    truths: list[Truth]


def held_out_seeds(seed: int, count: int) -> list[int]:
    """The evaluation scenes of the run of `seed`; no run of any seed trains on them."""
    return [holdout_seed(seed, FIRST + index) for index in range(count)]


def draw_held_out(seed: int) -> HeldOutView:
    """The one view of the scene of `seed`, as a training view is drawn, its sensor drawn too."""
    scene, rng = generate(seed), np.random.default_rng([seed, 2])
    view = draw_view(scene, Clearance.of(scene), rng)
    image = expose(view.rendering.color, Sensor.draw(rng), rng)
    return HeldOutView(seed=seed, png=png_of(image), truths=truths_of(scene, view))


def held_out_views(folder: Path, seeds: Sequence[int], workers: int, progress: Progress) -> Iterator[HeldOutView]:
    """Yield the view of each scene, rendered once; see `kept`."""
    kind = folder / f"scenes-{generator_digest()[:12]}"
    return kept(kind, seeds, draw_held_out, HeldOutView, workers=workers, report=progress)


def generator_digest() -> str:
    """The SHA-256 of the sources that determine the scenes."""
    sources = sorted(Path(str(world.__file__)).parent.rglob("*.py"))
    own = [Path(str(viewpoints.__file__))]
    digest = hashlib.sha256()
    for source in (*sources, *own, Path(__file__), Path(__file__).with_name("truths.py")):
        digest.update(source.name.encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()
