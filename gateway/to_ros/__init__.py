"""The fleet's results on their way back to the robot's own ROS graph, while somebody there listens."""
