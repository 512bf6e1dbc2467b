"""ROS 1 to Zenoh and back on each robot. `gateway.ros1` is the ROS 1 protocol as a library; nothing here needs ROS installed."""
