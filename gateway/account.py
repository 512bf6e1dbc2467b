"""What a gateway says of itself."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bus.reporting import VERSION
from gateway.exploring import Explorer
from gateway.offers import Offers
from gateway.outgoing.returning import Return
from gateway.ros1.node import Node
from gateway.ros1.sim_clock import SimClock
from gateway.settings import GatewaySettings
from schemas.status import GatewayStatus


@dataclass(frozen=True, slots=True)
class Account:
    """Everything in a gateway that its status tells of. returns: those of the whole robot."""

    settings: GatewaySettings
    boot_id: str
    clock_id: str
    node: Node
    clock: SimClock
    explorer: Explorer
    offers: Offers
    returns: Sequence[Return[Any]]

    def status(self) -> GatewayStatus:
        """Account for everything so far."""
        return GatewayStatus(
            robot=self.settings.robot,
            boot_id=self.boot_id,
            clock_id=self.clock_id,
            sent_ns=time.time_ns(),
            waiting_for=self._waiting_for(),
            ros_time_ns=self.clock.ros_time_ns,
            clock_jumps=self.clock.jumps,
            streams=self.offers.streams(),
            returns=[*self.offers.returns(), *(returned.status() for returned in self.returns)],
            withdrawn=dict(self.offers.withdrawn()),
            version=VERSION,
        )

    def _waiting_for(self) -> str:
        if self.node.master_answers is False:
            return f"the ROS master at {self.settings.ros_master}"
        return self.explorer.waiting_for
