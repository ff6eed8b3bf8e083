#!/usr/bin/env bash
# Makes a folder with ROS 2's wheels, its generators of messages, and nav2_msgs built with them: two minutes of a core.
# usage: make_nav2_msgs.sh FOLDER
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$here/../../.." && pwd)"
"$root/examples/ros/make_wheels.sh" "$1"
[ -e "$1/.nav2_msgs" ] && exit 0 # made to the end: what was interrupted is made again
prefix="$(cd "$1" && pwd)"
"$root/.venv/bin/uv" pip install --quiet --python "$prefix/bin/python3" --requirement "$here/generators.txt"
# The wheels' configurations name folders of the machine that they were made on.
include="$("$prefix/bin/python3" -c 'import sysconfig; print(sysconfig.get_path("include"))')"
modules="$("$prefix/bin/python3" -c 'import sysconfig; print(sysconfig.get_path("platlib"))')"
# None does any more where it was interrupted after this line.
{ grep -rl /opt/python/cp311-cp311 "$prefix/share" --include='*.cmake' || [ $? = 1 ]; } | xargs --no-run-if-empty sed -i \
  -e "s#/opt/python/cp311-cp311/include/python3.11#$include#g" \
  -e "s#/opt/python/cp311-cp311/lib/python3.11/site-packages#$modules#g"
export AMENT_PREFIX_PATH="$prefix" CMAKE_PREFIX_PATH="$prefix" PATH="$prefix/bin:$PATH"
export LD_LIBRARY_PATH="$prefix/lib" PYTHONPATH="$modules"
cmake -S "$here/nav2_msgs" -B "$prefix/nav2_msgs" -DCMAKE_INSTALL_PREFIX="$prefix" -DPython3_EXECUTABLE="$prefix/bin/python3"
cmake --build "$prefix/nav2_msgs" --parallel 2
cmake --install "$prefix/nav2_msgs"
touch "$prefix/.nav2_msgs"
