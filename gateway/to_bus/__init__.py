"""ROS topics on their way to Zenoh: translated, thinned out, compressed, and sent while somebody wants them."""
