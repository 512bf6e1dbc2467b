"""Which sensors there are, and whose points are a camera's. Pure."""

from collections import defaultdict
from collections.abc import Mapping

from schemas.keys import CameraKey, Stream, StreamKey


class Sensors:
    """The cameras that are there. chosen: where a camera's points are from, by their names, where the settings say."""

    def __init__(self, chosen: Mapping[str, str]) -> None:
        self._chosen = chosen
        self._there: defaultdict[tuple[str, Stream], set[CameraKey]] = defaultdict(set)

    def note(self, key: StreamKey, *, alive: bool) -> None:
        """Note that a stream of points or colour came or went."""
        of = (key.camera.robot, key.stream)
        (self._there[of].add if alive else self._there[of].discard)(key.camera)
        if not self._there[of]:
            del self._there[of]

    def points_of(self, camera: CameraKey) -> CameraKey | None:
        """Return whose points are those of a camera, if they are there.

        Its own; else those of the first, by name, of the robot's sensors that see no colour: a lidar.
        """
        there, colors = (self._there.get((camera.robot, stream), set()) for stream in (Stream.POINTS, Stream.COLOR))
        if camera.camera in self._chosen:
            chosen = CameraKey(camera.robot, self._chosen[camera.camera])
            return chosen if chosen in there else None
        if camera in there:
            return camera
        return min(there - colors, default=None)
