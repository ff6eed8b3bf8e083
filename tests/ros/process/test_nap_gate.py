"""Naps of small programs that end when this process says so, or by themselves where it cannot say so."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest

from tasks.ros.lockstep.ros_lane import EventPump
from tasks.ros.process import nap_gate
from tasks.ros.process.nap_gate import Door, NapGate
from tests.repository import ROOT

# A program that naps as roscpp does, by nanosleep(2), and says what it did on its standard output.
NAPS = """
import ctypes, os, sys, threading, time
libc = ctypes.CDLL(None, use_errno=True)
def nap(microseconds=1000):
    return libc.usleep(microseconds) and ctypes.get_errno()
def bad(address):
    return libc.nanosleep(ctypes.c_void_p(address), None) and ctypes.get_errno()
def say(*words):
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())
"""
Start = Callable[[str], "subprocess.Popen[bytes]"]


@pytest.fixture
def pump() -> Iterator[EventPump]:
    found = EventPump()
    yield found
    found.close()


@pytest.fixture
def gate(pump: EventPump) -> Iterator[NapGate]:
    found = NapGate(pump.loop)
    with found.door() as door:
        if not door.command:
            pytest.skip(found.gaps()[0])
    found.hold = True
    yield found
    found.close()


@pytest.fixture
def start(gate: NapGate) -> Iterator[Start]:
    """Starts a program at the gate."""
    started: list[subprocess.Popen[bytes]] = []

    def begin(program: str) -> "subprocess.Popen[bytes]":
        with gate.door() as door:
            found = launched(door, program)
        started.append(found)
        return found

    yield begin
    for each in started:
        each.kill()
        each.communicate()


def launched(door: Door, program: str) -> "subprocess.Popen[bytes]":
    command = [*door.command, sys.executable, "-I", "-S", "-c", NAPS + program]
    return subprocess.Popen(command, stdout=subprocess.PIPE, pass_fds=door.files)


def serve_until(pump: EventPump, done: Callable[[], object]) -> None:
    while not done():
        pump.nap(0.001)
        pump.serve()


def said(process: "subprocess.Popen[bytes]") -> bytes:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_a_nap_of_a_millisecond_ends_when_it_is_ended(pump: EventPump, gate: NapGate, start: Start) -> None:
    process = start("nap(); say('over'); nap()")
    serve_until(pump, lambda: gate.held)
    assert list(gate.held) == [process.pid]
    gate.end(process.pid)
    assert said(process) == b"over"
    serve_until(pump, lambda: gate.held)
    assert process.poll() is None


@pytest.mark.parametrize("told", ["end", "end_births"])
def test_a_thread_that_a_thread_made_begins_when_it_is_told(
    pump: EventPump, gate: NapGate, start: Start, told: str
) -> None:
    """Its process, one that it starts, and threads of one that has not napped begin by themselves."""
    program = "import _thread, subprocess\nearly = threading.Thread(target=say, args=('early',))\n"
    program += "early.start(); early.join()\nsubprocess.run(['true'], check=True)\nnap()\n"
    process = start(program + "_thread.start_new_thread(say, ('born',))\nsay('made'); time.sleep(9)")
    serve_until(pump, lambda: gate.held)
    gate.end(process.pid)
    serve_until(pump, lambda: gate.held or process.poll() is not None)
    assert [said(process), said(process)] == [b"early", b"made"]
    (tid,) = gate.held
    assert tid != process.pid
    gate.end_births() if told == "end_births" else gate.end(tid)
    assert (said(process), gate.held) == (b"born", {})


def test_other_naps_end_by_themselves(pump: EventPump, gate: NapGate, start: Start) -> None:
    """Longer and shorter ones, those until a time, and one that no memory tells of, which fails as it does anywhere."""
    process = start("nap(1001); nap(999); time.sleep(0.001); say(*map(bad, (1 << 63, 16)))")
    serve_until(pump, lambda: process.poll() is not None)
    assert (said(process), gate.held, gate.gaps()) == (b"14 14", {}, [])


def test_naps_are_in_the_order_in_which_nodes_were_started_and_threads_made(
    pump: EventPump, gate: NapGate, start: Start
) -> None:
    program = "made = [threading.Thread(target=nap) for _ in range(3)]\nfor each in made: each.start()\n"
    program += "say(*(each.native_id for each in made)); nap()"
    first, second = start(program), start(program)
    serve_until(pump, lambda: gate.end_births() or len(gate.held) == 8)
    made = [[process.pid, *map(int, said(process).split())] for process in (first, second)]
    assert gate.in_order() == [*made[0], *made[1]]


def test_naps_of_processes_that_a_node_starts_are_held_as_well(pump: EventPump, gate: NapGate, start: Start) -> None:
    process = start("child = os.fork()\nif not child: nap(); os._exit(0)\nsay(child, os.waitpid(child, 0)[1])")
    serve_until(pump, lambda: gate.held)
    (child,) = gate.held
    gate.end(child)
    assert said(process) == f"{child} 0".encode()


def test_a_signal_during_a_nap_is_dealt_with_and_the_nap_is_held_again(
    pump: EventPump, gate: NapGate, start: Start
) -> None:
    goes_on = "import signal; signal.signal(10, lambda *_: None); signal.siginterrupt(10, False)\n"
    process = start(goes_on + "nap(); say('over')")
    serve_until(pump, lambda: gate.held)
    before = gate.held[process.pid].request
    process.send_signal(signal.SIGUSR1)
    serve_until(pump, lambda: gate.held[process.pid].request != before)
    gate.end(process.pid)
    assert said(process) == b"over"


def test_nodes_that_are_about_to_end_need_nobody_who_runs_the_loop(
    pump: EventPump, gate: NapGate, start: Start
) -> None:
    process, other = start("for _ in range(9): nap()"), start("nap()")
    serve_until(pump, lambda: len(gate.held) == 2)
    while process.poll() is None:
        gate.let_go({process.pid})
    assert list(gate.held) == [other.pid]


def test_nobody_sleeps_on_when_the_gate_is_gone(pump: EventPump, gate: NapGate, start: Start) -> None:
    process = start("say(nap(), nap(), nap(2000))")
    serve_until(pump, lambda: gate.held)
    gate.close()
    assert said(process) == f"{errno.ENOSYS} {errno.ENOSYS} {errno.ENOSYS}".encode()


def test_who_is_killed_leaves_nobody_asleep() -> None:
    program = """
import subprocess, sys
from tasks.ros.lockstep.ros_lane import EventPump
from tasks.ros.process.nap_gate import NapGate
pump = EventPump()
gate = NapGate(pump.loop)
gate.hold = True
with gate.door() as door:
    subprocess.Popen([*door.command, sys.executable, '-I', '-S', '-c', sys.argv[1]], pass_fds=door.files)
while not gate.held and not gate.gaps():
    pump.nap(0.01)
    pump.serve()
print(*gate.gaps(), file=sys.stderr, flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", program, NAPS + "say(nap())"]
    pipe = subprocess.PIPE
    holder = subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, stderr=pipe)
    assert holder.stdout is not None
    assert holder.stderr is not None
    told = holder.stderr.readline().strip()
    holder.kill()
    node_said = holder.stdout.readline()
    holder.communicate()
    if told:
        pytest.skip(told.decode())
    assert node_said == f"{errno.ENOSYS}\n".encode()


def test_a_node_whose_processes_have_ended_is_given_up(pump: EventPump, gate: NapGate, start: Start) -> None:
    process = start("nap()")
    serve_until(pump, lambda: gate.held)
    process.kill()
    serve_until(pump, lambda: not gate.held)
    assert process.wait() == -signal.SIGKILL


def test_a_program_finds_signals_and_variables_as_it_would_without_the_gate(
    pump: EventPump, gate: NapGate, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    shows = "import json, os\ns = open('/proc/self/status').read()\n"
    shows += "e = open('/proc/self/environ').read()\n"
    shows += (
        "print([l for l in s.splitlines() if l.startswith(('SigIgn', 'SigBlk', 'SigCgt'))], sorted(e.split('\\0')))"
    )
    for name in ("LANG", "LC_ALL", "LC_CTYPE"):
        monkeypatch.delenv(name, raising=False)
    found = list[str]()
    for at_gate in (False, True):
        with gate.door() as door:
            command = [*(door.command if at_gate else ()), sys.executable, "-I", "-S", "-c", shows]
            process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, pass_fds=door.files)
        serve_until(pump, lambda process=process: process.poll() is not None)
        found.append(process.communicate()[0])
    assert found[0] == found[1] != ""


def test_a_program_that_is_not_there_says_so(pump: EventPump, gate: NapGate) -> None:
    with gate.door() as door:
        process = subprocess.Popen([*door.command, "/no/node"], stderr=subprocess.PIPE, pass_fds=door.files)
    told = process.communicate()[1]
    assert (process.returncode, told) == (127, b"/no/node cannot be run: No such file or directory\n")


def test_a_node_runs_without_the_gate_where_the_kernel_refuses_it(pump: EventPump, gate: NapGate) -> None:
    """A process has one such filter at most: what runs inside of somebody else's is refused another one."""
    inner = NapGate(pump.loop)
    inner.hold = True
    with gate.door() as outside, inner.door() as inside:
        door = Door((*outside.command, *inside.command), (*outside.files, *inside.files))
        process = launched(door, "say('runs')")
    serve_until(pump, lambda: inner.gaps() and process.poll() is not None)
    assert said(process) == b"runs"
    busy = f"seccomp: {os.strerror(errno.EBUSY)}"
    assert inner.gaps() == [f"threads of its nodes may race, since their naps do not end one at a time: {busy}"]
    with inner.door() as door:
        assert door == Door()
    process.communicate()
    inner.close()


@pytest.mark.parametrize(
    ("machine", "release", "why"),
    [
        ("riscv64", "6.1.0", "no filter of system calls for riscv64"),
        ("x86_64", "5.4.0-150-generic", "5.5 is the first"),
    ],
)
def test_a_machine_that_cannot_hold_naps_is_named(
    pump: EventPump, monkeypatch: pytest.MonkeyPatch, machine: str, release: str, why: str
) -> None:
    uname = os.uname_result(("Linux", "here", release, "#1", machine))
    monkeypatch.setattr(nap_gate.platform, "machine", lambda: machine)
    monkeypatch.setattr(nap_gate.os, "uname", lambda: uname)
    refused = NapGate(pump.loop)
    with refused.door() as door:
        assert door == Door()
    (gap,) = refused.gaps()
    assert why in gap


def test_nobody_holds_naps_without_a_loop() -> None:
    gate = NapGate()
    with gate.door() as door:
        assert (door, gate.gaps()) == (Door(), [])
