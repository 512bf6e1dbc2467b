"""Work that any number of workers share with no coordinator: who looks after which camera, and how much it can take."""

from bus.sharing.pace import Pace
from bus.sharing.settings import SharingSettings
from bus.sharing.sharing import Serve, Sharing

__all__ = ["Pace", "Serve", "Sharing", "SharingSettings"]
