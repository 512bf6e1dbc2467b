"""Calls a robot's ROS service from the command line."""
