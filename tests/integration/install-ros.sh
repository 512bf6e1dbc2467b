#!/usr/bin/env bash
# Install Debian's own ROS 1, the independent peer of the integration tests, where that is allowed and possible.
set -euo pipefail
packages=(
    python3-rosmaster python3-rospy python3-rosbag rosbash python3-rostopic
    python3-rosnode python3-rosparam python3-roslaunch topic-tools rviz xvfb
    python3-sensor-msgs python3-std-msgs python3-std-srvs python3-stereo-msgs python3-tf2-msgs python3-tf2-ros
)

missing=()
for package in "${packages[@]}"; do
    dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
done
[ ${#missing[@]} = 0 ] && exit 0

without() {
    printf '[setup] %s: the integration tests with real ROS 1 will be reported as skipped\n' "$1" >&2
    [ -z "${CI:-}" ]  # there they all have to run
    exit
}

if [ "$(id -u)" = 0 ]; then root=(); else root=(sudo -n); fi
command -v apt-get >/dev/null || without "no apt-get here to install ROS 1 with"
"${root[@]}" true 2>/dev/null || without "neither root nor sudo, so no ROS 1 (${missing[*]})"
echo "[setup] installing Debian's ROS 1: ${missing[*]}"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
export DEBIAN_FRONTEND=noninteractive
if ! { "${root[@]}" apt-get update && "${root[@]}" apt-get install -y --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
    tail -n 5 "$log" >&2
    without "Debian's ROS 1 could not be installed"
fi
