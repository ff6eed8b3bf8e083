#!/usr/bin/env bash
# `make ros`: ROS 1 from Debian, then AWS's hello_world_robot, unmodified, from its launch file to a robot.
# SIMYARD_HELLO_WORLD names a folder that has its packages; else they come from GitHub; else Simyard's own example runs.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$here/../.." && pwd)"
work="${SIMYARD_ROS_WORK:-$PWD/.simyard/ros}"
simyard="${SIMYARD_COMMAND:-$root/.venv/bin/simyard}"

has_ros() { [ -e /opt/ros/noetic/bin/roslaunch ] || command -v roslaunch >/dev/null; }
if ! has_ros; then
  command="apt-get install --no-install-recommends $(tr '\n' ' ' <"$here/debian.txt")"
  if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "ROS 1 is not here, and only root installs it (Debian 12): $command" >&2
    exit 1
  fi
  echo "installing ROS 1: $command"
  { apt-get update -q && DEBIAN_FRONTEND=noninteractive $command -y -q; } </dev/null
fi

clone() { # repository, branch, folder
  [ -d "$3" ] || GIT_TERMINAL_PROMPT=0 timeout 120 git clone -q --depth 1 -b "$2" "https://github.com/$1" "$3"
}
from_github() {
  clone aws-robotics/aws-robomaker-sample-application-helloworld ros1 "$work/git/helloworld" &&
    clone aws-robotics/turtlebot3-description-reduced-mesh ros1 "$work/git/turtlebot3_description_reduced_mesh" &&
    clone ros/xacro noetic-devel "$work/git/xacro"
}

mkdir -p "$work/git"
if [ -n "${SIMYARD_HELLO_WORLD:-}" ]; then
  packages="$SIMYARD_HELLO_WORLD"
elif from_github 2>"$work/git.log"; then
  packages="$work/git"
else
  echo "hello_world_robot cannot be had ($(tail -n 1 "$work/git.log")): Simyard's own ROS package runs in its place"
  exec "$simyard" run "$root/examples/ros.yaml" --direct
fi

# The bundle: the packages as they are, and beside them the robot that they are for.
rm -rf "$work/hello" "$work/drills"
mkdir -p "$work/hello"
for package in hello_world_robot turtlebot3_description_reduced_mesh xacro; do
  found="$(grep -rl --include=package.xml "<name>$package</name>" "$packages" | head -n 1)"
  [ -n "$found" ] || { echo "$packages has no package $package" >&2; exit 1; }
  cp -r "$(dirname "$found")" "$work/hello/$package"
  rm -rf "$work/hello/$package/.git" "$work/hello/$package/meshes"
done
# Where xacro's build installs its program.
[ -e "$work/hello/xacro/xacro" ] || cp "$work/hello/xacro/scripts/xacro" "$work/hello/xacro/xacro"
cp "$here/turtlebot3/waffle_pi.xml" "$work/hello/robot.xml"
cat >"$work/hello/ros.yaml" <<'END'
frames: {base: base_footprint, laser: base_scan, imu: imu_link}
lidar: {rays: 360, range_m: 3.5, height_m: 0.132, x_m: -0.064}
END
cp -r "$here/drills" "$work/drills"
cp "$here/hello.yaml" "$root/examples/templates/two-rooms.json" "$work/"
exec "$simyard" run "$work/hello.yaml" --direct
