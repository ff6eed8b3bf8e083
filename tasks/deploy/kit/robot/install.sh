#!/bin/sh
# Installs the agent of one robot, or brings it up to date: sudo ./install.sh NAME
# What is in /etc/simyard/agent.env stays. Inside an image (chroot), where no systemd runs, nothing is started.
# DESTDIR=FOLDER is for trying it out: everything lands below that folder, and works only there.
set -eu

if [ $# -ne 1 ]; then
    echo "usage: $0 ROBOT" >&2
    exit 2
fi
robot=$1
destination=${DESTDIR:-}
kit=$(cd "$(dirname "$0")" && pwd)
agent=$destination/opt/simyard-agent
settings=$destination/etc/simyard
units=$destination/etc/systemd/system

python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "Python 3.11 or later is needed, this is $(python3 --version)" >&2
    exit 1
}
# The unit runs as a user of its own, who sees no home folders.
interpreter=$(python3 -c 'import os, sys; print(os.path.realpath(sys.executable))')
case $interpreter in
/root/* | /home/*)
    if [ -z "$destination" ]; then
        echo "python3 is $interpreter, which a service cannot reach; install Python below /usr or /opt" >&2
        exit 1
    fi
    ;;
esac
if [ -z "$destination" ]; then
    id simyard >/dev/null 2>&1 || useradd --system --home-dir /var/lib/simyard --shell /usr/sbin/nologin simyard
fi

mkdir -p "$settings" "$units" "$destination/opt"
[ -f "$settings/agent.env" ] || install -m 600 "$kit/agent.env" "$settings/agent.env"
[ ! -f "$kit/root.json" ] || install -m 644 "$kit/root.json" "$settings/root.json"
install -m 644 "$kit/simyard-agent@.service" "$units/"

# Only S3 needs its client, which is most of what there is to download.
extra=
if grep -q '^SIMYARD_STORE=.*s3://' "$settings/agent.env"; then extra='[s3]'; fi
[ -x "$agent/bin/python" ] || python3 -m venv "$agent"
for wheel in "$kit"/simyard_agent-*.whl; do
    "$agent/bin/python" -m pip install --quiet "$wheel$extra"
    "$agent/bin/python" -m pip install --quiet --no-deps --force-reinstall "$wheel"
done
"$agent/bin/python" -m compileall -q "$agent/lib"

if [ -n "$destination" ]; then
    echo "the agent of $robot is installed below $destination; start it as ExecStart in $units says"
    exit 0
fi
systemctl enable "simyard-agent@$robot"
if [ -d /run/systemd/system ]; then
    systemctl daemon-reload
    systemctl restart "simyard-agent@$robot"
    echo "the agent of $robot runs; its log: journalctl -u simyard-agent@$robot"
else
    echo "the agent of $robot is installed; it starts with the robot"
fi
