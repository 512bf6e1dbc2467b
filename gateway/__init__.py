"""ROS 1 to Zenoh and back on each robot, without a ROS install. `gateway.ros1` is the ROS 1 protocol as a library."""
