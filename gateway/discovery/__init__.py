"""Which of a robot's ROS topics become which streams, decided without I/O from what its master says."""

from gateway.discovery.plan import Plan, Wishes, plan
from gateway.discovery.unclear import unclear, unclear_clouds

__all__ = ["Plan", "Wishes", "plan", "unclear", "unclear_clouds"]
