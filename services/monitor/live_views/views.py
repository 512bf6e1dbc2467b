"""All live views of one monitor."""

from collections.abc import Callable

from bus import Bus
from services.monitor.live_views.newest import clouds, lists, pictures
from services.monitor.map.following import robots
from services.monitor.map.last_poses import LastPoses


class Views:
    """pictures: overlays. lists: class lists by frame. clouds: of objects. robots: their poses.

    Each is subscribed to while somebody looks.
    last_poses: where robots were when somebody looked. is_forgotten: see `LastPoses`.
    """

    def __init__(self, bus: Bus, is_forgotten: Callable[[str], bool]) -> None:
        self.pictures = pictures(bus)
        self.lists = lists(bus)
        self.clouds = clouds(bus)
        self.robots = robots(bus)
        self.last_poses = LastPoses(is_forgotten)
