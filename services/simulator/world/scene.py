"""A whole warehouse: its cuboids, its objects, its light."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.simulator.world.cuboids import CLASSES, ClassName, Cuboids, Floats
from services.simulator.world.floor import Floor
from services.simulator.world.lighting import Lighting
from services.simulator.world.surfaces import Surfaces


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A hall of 2 * half_x by 2 * half_y metres around the map's origin.

    `instance_classes[i]` is the index in `CLASSES` of instance i, and -1 for instance 0, the background.
    Cuboid 0 is the floor.
    """

    seed: int
    half_x: float
    half_y: float
    cuboids: Cuboids
    instance_classes: NDArray[np.int32]
    lighting: Lighting
    floor: Floor
    surfaces: Surfaces

    def class_name(self, instance: int) -> ClassName:
        """The name of an object's class. Raises ValueError for the background."""
        index = int(self.instance_classes[instance])
        if index < 0:
            raise ValueError("the background has no class")
        return CLASSES[index]

    def instance_centres(self) -> Floats:
        """The centre of each instance's bounding box, (instances, 3), NaN for the background."""
        centres = np.full((len(self.instance_classes), 3), np.nan, np.float32)
        corners = self.cuboids.corners()
        order = np.argsort(self.cuboids.instances, kind="stable")
        owners = self.cuboids.instances[order]
        starts = np.flatnonzero(np.r_[True, owners[1:] != owners[:-1]])
        low = np.minimum.reduceat(corners.min(axis=1)[order], starts)
        high = np.maximum.reduceat(corners.max(axis=1)[order], starts)
        centres[owners[starts]] = (low + high) / 2
        centres[0] = np.nan
        return centres
