"""Everything that people look at through one monitor."""

from bus import Bus
from services.monitor.looking.newest import clouds, pictures
from services.monitor.mapping.following import robots


class Views:
    """pictures: overlays. clouds: of objects. robots: where they are. Each is subscribed to while somebody looks."""

    def __init__(self, bus: Bus) -> None:
        self.pictures = pictures(bus)
        self.clouds = clouds(bus)
        self.robots = robots(bus)
