"""ROS topics to Zenoh: translated, rate-limited, compressed, and sent while there is demand."""
