#!/bin/sh
# After the courier was launched: waits, ten seconds at most, until its heart beats.
set -eu

tries=0
until [ -s heartbeat ]; do
    tries=$((tries + 1))
    if [ "$tries" -gt 100 ]; then
        echo "no heartbeat after 10 s" >&2
        exit 1
    fi
    sleep 0.1
done
