"""Which sensors there are, and whose points are a camera's. Pure."""

from collections.abc import Mapping

from schemas.keys import CameraKey, Stream, StreamKey


class Sensors:
    """The cameras that are there. chosen: where a camera's points are from, by their names, where the settings say."""

    def __init__(self, chosen: Mapping[str, str]) -> None:
        self._chosen = chosen
        self._there: dict[Stream, set[CameraKey]] = {Stream.COLOR: set(), Stream.POINTS: set()}

    def note(self, key: StreamKey, *, alive: bool) -> None:
        """Note that a stream of points or colour came or went."""
        cameras = self._there[key.stream]
        (cameras.add if alive else cameras.discard)(key.camera)

    def points_of(self, camera: CameraKey) -> CameraKey | None:
        """Return whose points are those of a camera, if they are there.

        Its own; else those of the first, by name, of the robot's sensors that see no colour: a lidar.
        """
        there, colors = self._there[Stream.POINTS], self._there[Stream.COLOR]
        if camera.camera in self._chosen:
            chosen = CameraKey(camera.robot, self._chosen[camera.camera])
            return chosen if chosen in there else None
        if camera in there:
            return camera
        lidars = (key for key in there if key.robot == camera.robot and key not in colors)
        return min(lidars, default=None)
