#!/bin/sh
# What is launched on the courier: stays up, and shows that it lives by a heartbeat in its working directory, until it
# is told to stop.
set -eu

heartbeat=heartbeat
stop() {
    rm -f "$heartbeat"
    exit 0
}
trap stop TERM INT

echo "courier up, at most ${MAX_SPEED:-0.5} m/s"
while :; do
    date +%s >"$heartbeat.new"
    mv "$heartbeat.new" "$heartbeat"
    # In the background, so that a signal is answered at once and not after the second is over.
    sleep 1 &
    wait $!
done
