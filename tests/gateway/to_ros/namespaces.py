"""What a gateway's ROS names mean, for tests."""

from gateway.ros1.names import Names

IN_ROOT = Names("/gateway", {}).resolve
