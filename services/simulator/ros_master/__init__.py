"""A ROS 1 master in this process, so that simulated robots need no ROS installation."""
