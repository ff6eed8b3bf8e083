#!/bin/sh
# What is launched on the robot: shows that it lives by a heartbeat, until it is told to stop.
set -eu

trap 'rm -f heartbeat; exit 0' TERM INT
echo "up: $(cat ./*/*.onnx | wc -c) bytes of network"
while :; do
    date +%s >heartbeat.new
    mv heartbeat.new heartbeat
    sleep 1 &
    wait $!
done
