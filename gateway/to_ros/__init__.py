"""Zenoh to ROS: returns the fleet's results to the robot's ROS graph, while somebody subscribes."""
