"""How long the services take for what they receive, and the guide's own steps for the same, in turn."""

import itertools
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from benchmarks.space import guide
from benchmarks.space.errors import masks_of
from benchmarks.space.messages import cloud_of, depth_of, detections_of, header, info_of, transforms_of, true_detections
from benchmarks.space.paths import CloudPath, DistancePath
from benchmarks.space.views import SpaceView, seeds, view_from
from schemas import codec
from schemas.detections import Detections
from services.simulator.placement import COLOR_OPTICAL, LIDAR
from services.simulator.world import SeenObject, generate
from services.simulator.world.clearance import Clearance
from services.training.viewpoints import draw_pose

OBJECTS: Final = 20
WARM_UP: Final = 3
FIRST: Final = 210_000
"""The number, among a run's held-out scenes, of the first that is looked at for a view of so many objects."""

Times = defaultdict[str, list[float]]


def crowded_views(count: int) -> list[SpaceView]:
    """Return views of 640x480 pixels in which there are OBJECTS objects of some size, within reach or beyond it."""
    drawn = (_drawn(seed) for (seed,) in (seeds(1, FIRST + index) for index in itertools.count()))
    return list(itertools.islice((view for view in drawn if len(_largest(view)) == OBJECTS), count))


def _drawn(seed: int) -> SpaceView:
    scene = generate(seed)
    return view_from(scene, draw_pose(scene, Clearance.of(scene), np.random.default_rng([seed, 6, 1])))


def _largest(view: SpaceView) -> list[SeenObject]:
    return sorted(view.objects, key=lambda seen: -seen.pixels)[:OBJECTS]


def measure(views: Sequence[SpaceView], rounds: int) -> tuple[Times, Times]:
    """Return milliseconds by what was done: on the clock, and of the processor."""
    wall, cpu = Times(list), Times(list)
    for view in views:
        works = _works(view)
        for turn in range(WARM_UP + rounds):
            for name, work in works.items():
                begun, used = time.perf_counter(), time.process_time()
                work()
                if turn >= WARM_UP:
                    wall[name].append(1e3 * (time.perf_counter() - begun))
                    cpu[name].append(1e3 * (time.process_time() - used))
    return wall, cpu


def _works(view: SpaceView) -> dict[str, Callable[[], object]]:
    """Return what is timed; everything that the model or a driver does is done before."""
    head = header(COLOR_OPTICAL)
    info, said = info_of(view.camera, head), transforms_of(view.joints())
    objects = true_detections(_largest(view))
    found = codec.encode(detections_of(objects, view.camera, head))
    depth = depth_of(view.depth, head)
    cloud, sweep = cloud_of(view.points, head), cloud_of(view.sweep, header(LIDAR))
    distance, clouds = DistancePath(info), CloudPath(info, said)
    distance.sensed.transforms.take(said, static=True)
    masks, layout, size = masks_of(objects, view), view.points.dtype, view.points.shape

    def detections() -> Detections:
        return codec.decode(Detections, found, codec.encoding(Detections))

    def guide_clouds() -> None:
        for _ in guide.clouds(masks, *guide.read_cloud(cloud.data, layout, *size)):
            pass

    return {
        "distance": lambda: distance.measure(detections(), depth),
        "guide_distance": lambda: guide.distances(masks, view.depth),
        "cloud": lambda: clouds.cut(detections(), cloud),
        "guide_cloud": guide_clouds,
        "lidar": lambda: clouds.cut(detections(), sweep),
    }
