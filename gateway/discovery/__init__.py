"""Decides which of a robot's ROS topics become which streams, from the master's lists, without I/O. Pure."""

from gateway.discovery.plan import DiscoverySettings, Plan, plan
from gateway.discovery.unclear import unclear, unclear_clouds

__all__ = ["DiscoverySettings", "Plan", "plan", "unclear", "unclear_clouds"]
