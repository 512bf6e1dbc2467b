"""Silent cameras: their open intervals end in the history, and reopen when they resume. Pure."""

from services.monitor.history.intervals import Sightings
from services.monitor.inventory.camera import CameraView
from services.monitor.inventory.camera_liveness import SpeakingCameras
from services.monitor.inventory.inventory import Inventory


class Silence:
    """Enters silent cameras in a ledger."""

    def __init__(self, inventory: Inventory, sightings: Sightings) -> None:
        self._inventory = inventory
        self._sightings = sightings
        self.begin_anew()

    def begin_anew(self) -> None:
        """Find the silent cameras in a database that has all as live."""
        self._speaking = SpeakingCameras(self._inventory, self._speaks, speaks=True)

    def note(self, now_ns: int) -> None:
        """End the intervals of cameras that fell silent, and reopen them when the cameras resume."""
        for camera in self._speaking.advance(now_ns):
            if camera.lost:
                continue
            in_view = [sighting for sighting in camera.sightings() if sighting.count]
            if self._speaks(camera, now_ns):
                self._sightings.resume(in_view)
            else:
                self._sightings.pause(in_view)

    def _speaks(self, camera: CameraView, now_ns: int) -> bool:
        return camera.last_ns >= now_ns - self._inventory.limits.stale_ns
