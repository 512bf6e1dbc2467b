"""Work sharing without a coordinator: which worker serves which camera, and at what rate."""

from bus.sharing.pace import Pace
from bus.sharing.settings import SharingSettings
from bus.sharing.sharing import Serve, Sharing

__all__ = ["Pace", "Serve", "Sharing", "SharingSettings"]
