"""How far what was measured is from what is true, object by object. Pure."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.space import guide, paths
from benchmarks.space.matching import matched
from benchmarks.space.messages import true_detections
from benchmarks.space.views import SpaceView, is_asked_for
from schemas.detections import Detection
from schemas.distances import ObjectDistance
from schemas.objects import ObjectCloud, ObjectClouds
from services.geometry.boxes import axes_of
from services.geometry.masks import decode
from services.simulator.messages import metres
from services.simulator.world import DepthSensor, SeenObject

Samples = defaultdict[str, list[float]]
"""Values of figures by name, one for each object."""

Truths = dict[int, SeenObject]
"""What is true of the detections with these places."""

ALLOWED_M: Final = 0.05
ALLOWED_SHARE: Final = 0.01

FACE_SHARE: Final = 0.15
"""A face is seen well that has at least this share of the object's visible pixels."""

FACING: Final = 0.5
"""And that is seen at no more than 60 degrees from its normal, of which this is the cosine."""

SIGMAS: Final = 4.0
"""A point whose depth is off by more of the sensor's own error, and 5 cm, is of something else."""


def distance(measured: Sequence[ObjectDistance], truths: Truths) -> Iterator[float]:
    """Return the relative error of each distance that is said to be known."""
    for index, seen in truths.items():
        if (found := measured[index].measured) is not None:
            yield abs(found.axial_m - seen.depth_m) / seen.depth_m


def unknown(measured: Sequence[ObjectDistance], truths: Truths) -> Iterator[float]:
    """Return of each object 1 if its distance is said to be unknown, and else 0."""
    return (float(measured[index].measured is None) for index in truths)


def guide_distance(view: SpaceView, found: Sequence[Detection], truths: Truths, *, metric: bool) -> Iterator[float]:
    """Return the relative error of the guide's formula, on depth in metres with NaN, or in millimetres with 0."""
    masks = masks_of([found[index] for index in truths], view)
    means = guide.distances(masks, metres(view.depth) if metric else view.depth)
    for seen, mean in zip(truths.values(), means, strict=True):
        distance_m = mean if metric else mean / 1000
        yield min(1.0, abs(distance_m - seen.depth_m) / seen.depth_m)


def masks_of(found: Sequence[Detection], view: SpaceView) -> NDArray[np.float32]:
    """Return masks of the whole picture, n x height x width, as a model has them."""
    masks = np.zeros((len(found), view.camera.height, view.camera.width), np.float32)
    for number, each in enumerate(found):
        if each.mask is not None:
            window = decode(each.mask)
            masks[number][window.place] = window.pixels
    return masks


def centroid(cloud: ObjectCloud, seen: SeenObject) -> float:
    """Return by how many metres a centroid is farther off than it may be."""
    off = float(np.linalg.norm(np.array(cloud.shape.centroid) - seen.centroid))
    return off - ALLOWED_M - ALLOWED_SHARE * float(np.linalg.norm(seen.centroid))


def extents(cloud: ObjectCloud, seen: SeenObject) -> Iterator[float]:
    """Return the relative errors of a box's extents along its object's visible faces."""
    box, true = cloud.shape.box, seen.visible_box.seen_from(seen.view.pose)
    along = np.abs(axes_of(box) @ true.axes)
    length = 0 if along[0, 0] >= along[1, 0] else 1
    sizes = [box.size[length], box.size[1 - length], box.size[2]]
    for axis in _visible_axes(seen):
        yield abs(sizes[axis] - true.size[axis]) / true.size[axis]


def _visible_axes(seen: SeenObject) -> list[int]:
    """Return which of the axes of an object's box the faces that are seen well extend along."""
    box, pose = seen.box, seen.view.pose
    half = box.size / 2
    points = (pose.to_map(seen.points) - box.centre) @ box.axes / half
    eye = (pose.position - box.centre) @ box.axes / half
    across = np.abs(points).argmax(axis=1)  # what a face is across is where its points are the farthest out
    sides = np.sign(points[np.arange(len(across)), across])
    seen_along = set()
    for axis in range(3):
        face = points[(across == axis) & (sides == np.sign(eye[axis]))]
        if len(face) >= FACE_SHARE * len(points):
            ray = (eye - face.mean(axis=0)) * half
            if abs(ray[axis]) >= FACING * np.linalg.norm(ray):
                seen_along |= {0, 1, 2} - {axis}
    return sorted(seen_along)


def foreign(cloud: ObjectCloud, view: SpaceView, seen: SeenObject) -> float:
    """Return the share of an organised cloud's points that are of something else.

    Those are the points of other things' pixels, and those that are nowhere near what their pixels show.
    """
    xyz = np.frombuffer(cloud.xyz, "<f4").reshape(-1, 3).astype(np.float64)
    camera = view.camera
    columns = np.rint(xyz[:, 0] / xyz[:, 2] * camera.fx + camera.cx).astype(int)
    rows = np.rint(xyz[:, 1] / xyz[:, 2] * camera.fy + camera.cy).astype(int)
    true, sensor = view.rendering.depth[rows, columns], DepthSensor()
    noise = true**2 * sensor.subpixel / (sensor.baseline * camera.fx)
    other = view.rendering.instances[rows, columns] != seen.instance
    return float(np.mean(other | (np.abs(xyz[:, 2] - true) > ALLOWED_M + SIGMAS * noise)))


def add_view(view: SpaceView, found: Sequence[Detection], samples: Samples) -> None:
    """Add what is to be said of a view in which a model found something."""
    exact, truths = true_detections(view.objects), dict(enumerate(view.objects))
    matches = {index: seen for index, seen in matched(found, view.every_object).items() if is_asked_for(seen)}
    for suffix, masks, of in (("_gt_masks", exact, truths), ("", found, matches)):
        for name, registered in (("distance", True), ("distance_unregistered", False)):
            measured = paths.distances(view, masks, registered=registered)
            samples[f"{name}{suffix}"] += distance(measured, of)
            samples[f"unknown_{name}{suffix}"] += unknown(measured, of)
        samples[f"guide_distance{suffix}"] += guide_distance(view, masks, of, metric=False)
        samples[f"guide_distance_metres{suffix}"] += guide_distance(view, masks, of, metric=True)
    add_clouds(view, paths.clouds(view, exact), truths, "", samples)
    add_clouds(view, paths.clouds(view, found), matches, "_model_masks", samples)
    samples["missed_by_model"] += [float(seen not in matches.values()) for seen in view.objects]


def add_clouds(view: SpaceView, made: ObjectClouds, truths: Truths, suffix: str, samples: Samples) -> None:
    """Add what is to be said of clouds from a view's own points."""
    by_index = {cloud.index: cloud for cloud in made.objects}
    for index, seen in truths.items():
        cloud = by_index.get(index)
        samples[f"missing_clouds{suffix}"].append(float(cloud is None))
        if cloud is not None:
            samples[f"centroid_excess{suffix}"].append(centroid(cloud, seen))
            samples[f"box_extent{suffix}"] += extents(cloud, seen)
            samples[f"foreign_points{suffix}"].append(foreign(cloud, view, seen))
