"""Logs of servers: one each, old ones removed."""

import os
from pathlib import Path

from tasks.server.process import new_log, rename_log

_NO_PROCESS = 1 << 30


def test_each_server_has_a_log_of_its_own(tmp_path: Path):
    for pid in (_NO_PROCESS, _NO_PROCESS + 1):
        with new_log(tmp_path) as output:
            output.write(b"of %d" % pid)
            assert rename_log(output, pid) == tmp_path / f"server-{pid}.log"
    assert (tmp_path / f"server-{_NO_PROCESS}.log").read_text() == f"of {_NO_PROCESS}"
    assert len([*tmp_path.iterdir()]) == 2


def test_only_the_newest_logs_of_ended_servers_stay(tmp_path: Path):
    for age in range(9):
        log = tmp_path / f"server-{_NO_PROCESS + age}.log"
        log.touch()
        os.utime(log, (1000.0 - age, 1000.0 - age))
    running = tmp_path / f"server-{os.getpid()}.log"
    running.touch()
    os.utime(running, (1.0, 1.0))
    with new_log(tmp_path) as output:
        rename_log(output, 1)
    left = {log.name for log in tmp_path.iterdir()}
    newest = {f"server-{_NO_PROCESS + age}.log" for age in range(5)}
    assert left == {*newest, running.name, "server-1.log"}
