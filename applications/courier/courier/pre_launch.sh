#!/bin/sh
# Before the courier is launched: refuses a speed limit that it could not keep, and a folder it could not write to.
set -eu

limit=${MAX_SPEED:-0.5}
case $limit in
'' | *[!0-9.]* | *.*.* | .)
    echo "MAX_SPEED: $limit: must be a number of metres a second, such as 0.5" >&2
    exit 1
    ;;
esac
rm -f heartbeat
touch heartbeat.new
rm heartbeat.new
