#!/usr/bin/env bash
# Install Debian's own ROS 1, the screen that rviz is shown on, systemd, which checks the robot's units, and OpenSSL,
# which makes certificates as the documentation says.
set -euo pipefail
exec "$(dirname "$0")/debian.sh" "ROS 1" \
    python3-rosmaster python3-rospy python3-rosbag rosbash python3-rostopic \
    python3-rosnode python3-rosparam python3-roslaunch topic-tools rviz xvfb systemd openssl \
    python3-sensor-msgs python3-std-msgs python3-std-srvs python3-stereo-msgs python3-tf python3-tf2-msgs python3-tf2-ros \
    python3-visualization-msgs
