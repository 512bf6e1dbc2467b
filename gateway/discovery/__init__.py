"""Which of a robot's ROS topics become which streams, decided without I/O from what its master says. Pure."""

from gateway.discovery.plan import DiscoverySettings, Plan, plan
from gateway.discovery.unclear import unclear, unclear_clouds

__all__ = ["DiscoverySettings", "Plan", "plan", "unclear", "unclear_clouds"]
