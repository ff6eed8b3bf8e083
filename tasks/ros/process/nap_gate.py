"""Naps of a node's threads that end when lock-step says so, one at a time (``docs/decisions/0050-naps-in-order.md``).

``ros::Rate``, ``ros::Duration`` and ``tf`` nap for a millisecond, look at simulated time, and nap again. Of two threads
of a process that wait for the same tick, either one may look first. So a filter of system calls (seccomp(2)) hands
each nap to this process (seccomp_unotify(2)), which holds those of a millisecond and lets all others go on. A thread
that was just made races with the one that made it, so in nodes that nap it is held as well, in what the C library does
first in each thread (set_robust_list(2)).

The filter is put up by a small program that stands before a node's. It is text here, because it runs in a bare Python
that starts in no time. Where no filter can be put up, the node runs without one, and ``gaps`` says so. If this process
ends, the kernel fails all naps (ENOSYS): nobody sleeps on, and whatever started the nodes ends them.
"""

import asyncio
import contextlib
import fcntl
import os
import platform
import re
import select
import socket
import struct
import sys
from collections.abc import Collection, Generator
from pathlib import Path
from typing import NamedTuple

# Python ignores two signals, and may add a variable: whoever is run next shall find all as it was before.
DOOR = r"""
import _signal, ctypes, os, socket, struct, sys
own, call, code = socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2]), bytes.fromhex(sys.argv[3])
command, libc = sys.argv[4:], ctypes.CDLL(None, use_errno=True)

def do(result, what):
    if result < 0:
        raise OSError(ctypes.get_errno(), f"{what}: {os.strerror(ctypes.get_errno())}")
    return result

try:
    do(libc.prctl(38, 1, 0, 0, 0), "PR_SET_NO_NEW_PRIVS")
    steps = ctypes.create_string_buffer(code, len(code))
    head = struct.pack("HP", len(code) // 8, ctypes.addressof(steps))
    # With a listener; and nothing is slowed down against speculation, for this shuts nobody in.
    listener = do(libc.syscall(call, 1, 8 | 4, head), "seccomp")
    socket.send_fds(own, [str(os.getpid()).encode()], [listener])
    os.close(listener)
except OSError as exc:
    own.send(exc.strerror.encode())
own.close()
for each in (_signal.SIGPIPE, _signal.SIGXFSZ):
    _signal.signal(each, _signal.SIG_DFL)
with open("/proc/self/environ", "rb") as file:
    environment = dict(each.split(b"=", 1) for each in file.read().split(b"\0") if b"=" in each)
try:
    os.execvpe(command[0], command, environment)
except OSError as exc:
    sys.stderr.write(f"{command[0]} cannot be run: {exc.strerror}\n")
    sys.exit(127 if isinstance(exc, FileNotFoundError) else 126)
"""


class _Machine(NamedTuple):
    """Numbers that a kind of processor has of its own: what seccomp calls it, and of system calls."""

    audit: int
    seccomp: int
    nanosleep: int
    clock_nanosleep: int
    set_robust_list: int


_MACHINES = {"x86_64": _Machine(0xC000003E, 317, 35, 230, 273), "aarch64": _Machine(0xC00000B7, 277, 101, 115, 99)}
# The first that lets a call go on as if nobody had been asked.
_LEAST_LINUX = (5, 5)
_LOAD, _EQUAL, _RETURN, _ASK, _ALLOW = 0x20, 0x15, 0x06, 0x7FC00000, 0x7FFF0000
_NUMBER_AT, _AUDIT_AT, _SECOND_AT = 0, 4, 24
# Of a request: its number, the thread, the system call and what it is called with. Of an answer: number, result, error.
_REQUEST, _ANSWER, _LENGTH = struct.Struct("<QI4xi4x8x6Q"), struct.Struct("<QqiI"), struct.Struct("<qq")
_TAKE, _REPLY, _GO_ON = 0xC0502100, 0xC0182101, 1
HELD_S = 0.001
_WORDS_BYTES = 1024


class Door(NamedTuple):
    """What puts a node's threads at the gate.

    Attributes:
        command: Stands before the node's; empty where no nap can be held.
        files: Have to stay open for it.
    """

    command: tuple[str, ...] = ()
    files: tuple[int, ...] = ()


class HeldNap(NamedTuple):
    """A nap that waits to be ended.

    Attributes:
        order: Among all held naps of the application.
        listener: The file that it came on.
        request: Its number there.
        birth: Whether it is no nap, but a thread that has not begun.
    """

    order: tuple[int, int]
    listener: int
    request: int
    birth: bool = False


class _Listener(NamedTuple):
    """What a node's naps come on; the node's number is its place among the nodes that were started."""

    number: int
    pid: int
    file: int
    poll: "select.poll"


class NapGate:
    """The naps of one application.

    Args:
        loop: Serves it; None lets all naps be.

    Attributes:
        hold: Whether naps of a millisecond are held from now on; those of other lengths never are.
        held: Those that are, by thread.
        free: Threads whose naps never are.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop | None = None) -> None:
        self.hold = False
        self.held: dict[int, HeldNap] = {}
        self.free: set[int] = set()
        self._loop = loop
        self._machine = _MACHINES.get(platform.machine())
        self._refused = dict.fromkeys(filter(None, [_missing() if loop else ""]))
        self._doors, self._most_pids = 0, 0
        self._waiting: dict[int, socket.socket] = {}
        self._listeners: dict[int, _Listener] = {}
        # Nodes that napped for a millisecond: who waits for simulated time in another way may wait for its threads so.
        self._napped: set[int] = set()

    @contextlib.contextmanager
    def door(self) -> Generator[Door]:
        """Yields what a node is to be started with."""
        if self._loop is None or self._machine is None or self._refused:
            yield Door()
            return
        number, self._doors = self._doors, self._doors + 1
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._waiting[number] = ours
        self._loop.add_reader(ours, self._enter, number)
        arguments = (str(theirs.fileno()), str(self._machine.seccomp), _filter(self._machine).hex())
        with theirs:
            yield Door((sys.executable, "-I", "-S", "-c", DOOR, *arguments), (theirs.fileno(),))

    def in_order(self) -> list[int]:
        """Returns the threads whose nap is held, those of the node that was started first before the others.

        Threads of a node are in the order in which they were made, also where the numbers of threads begin again.
        """
        return sorted(self.held, key=lambda tid: self.held[tid].order)

    def end(self, tid: int) -> None:
        """Ends a nap that is held, as if its time were over."""
        nap = self.held.pop(tid)
        _answer(nap.listener, nap.request, _GO_ON if nap.birth else 0)

    def end_births(self) -> None:
        """Lets all threads begin that were made: whoever made them may wait for them without sleeping."""
        for tid in [tid for tid, nap in self.held.items() if nap.birth]:
            self.end(tid)

    def let_go(self, pids: Collection[int]) -> None:
        """Ends all naps of some nodes, which are about to end, while nobody runs the loop."""
        for listener in [each for each in self._listeners.values() if each.pid in pids]:
            self._serve(listener)
            for tid in [tid for tid, nap in self.held.items() if nap.listener == listener.file]:
                self.end(tid)

    def gaps(self) -> list[str]:
        """Returns why naps end by themselves, for a person."""
        what = "threads of its nodes may race, since their naps do not end one at a time"
        return [f"{what}: {why}" for why in self._refused]

    def close(self) -> None:
        """Closes all files, after which naps fail; a second time does nothing."""
        for number in list(self._waiting):
            self._forget_door(number)
        for listener in list(self._listeners.values()):
            self._drop(listener)

    def _enter(self, number: int) -> None:
        """Takes what a node's naps come on, or why there is no such thing."""
        words, files, _, _ = socket.recv_fds(self._waiting[number], _WORDS_BYTES, 1, socket.MSG_CMSG_CLOEXEC)
        self._forget_door(number)
        if files and self._loop is not None:
            self._most_pids = self._most_pids or int(Path("/proc/sys/kernel/pid_max").read_text())
            poll = select.poll()
            poll.register(files[0], select.POLLIN)
            self._listeners[number] = listener = _Listener(number, int(words), files[0], poll)
            self._loop.add_reader(files[0], self._serve, listener)
        elif words:  # nothing at all comes from one that was ended before
            self._refused[words.decode()] = None

    def _forget_door(self, number: int) -> None:
        with self._waiting.pop(number) as ours:
            if self._loop is not None:
                self._loop.remove_reader(ours)

    def _serve(self, listener: _Listener) -> None:
        """Takes all naps that have come; gives a node up whose processes have all ended."""
        while found := listener.poll.poll(0):
            if not found[0][1] & select.POLLIN:
                self._drop(listener)
                return
            self._take(listener)

    def _take(self, listener: _Listener) -> None:
        request = bytearray(_REQUEST.size)
        try:
            fcntl.ioctl(listener.file, _TAKE, request)
        except FileNotFoundError:  # a signal came first
            return
        number, tid, call, *arguments = _REQUEST.unpack(request)
        birth = self._machine is not None and call == self._machine.set_robust_list
        address = arguments[0 if self._machine and call == self._machine.nanosleep else 2]
        if birth:
            held = listener.number in self._napped and _made_by_thread(tid)
        elif held := self._length_ns(tid, address) == round(HELD_S * 1e9):
            self._napped.add(listener.number)
        if held and self.hold and tid not in self.free:
            order = (listener.number, (tid - listener.pid) % self._most_pids)
            self.held[tid] = HeldNap(order, listener.file, number, birth)
        else:
            _answer(listener.file, number, _GO_ON)

    def _length_ns(self, tid: int, address: int) -> int:
        """Returns how long a thread wants to nap; 0 where that cannot be read."""
        try:
            memory = os.open(f"/proc/{tid}/mem", os.O_RDONLY)
        except PermissionError:  # as Yama may say
            self._refused["this kernel lets nobody read how long they are (/proc/<pid>/mem)"] = None
            return 0
        except OSError:
            return 0
        try:
            seconds, nanoseconds = _LENGTH.unpack(os.pread(memory, _LENGTH.size, address))
        except (OSError, OverflowError, struct.error):  # a node may call with any address
            return 0
        finally:
            os.close(memory)
        return seconds * 10**9 + nanoseconds

    def _drop(self, listener: _Listener) -> None:
        if self._loop is not None:
            self._loop.remove_reader(listener.file)
        del self._listeners[listener.number]
        self.held = {tid: nap for tid, nap in self.held.items() if nap.listener != listener.file}
        os.close(listener.file)


def _missing() -> str:
    """Returns why this machine lets no naps be held; empty if it does, as far as one knows before."""
    machine, release = platform.machine(), os.uname().release
    if machine not in _MACHINES:
        return f"no filter of system calls for {machine}"
    version = tuple(int(each) for each in re.findall(r"\d+", release)[:2])
    least = ".".join(map(str, _LEAST_LINUX))
    return "" if version >= _LEAST_LINUX else f"Linux {release}, and {least} is the first that can (seccomp_unotify)"


def _filter(machine: _Machine) -> bytes:
    """Returns the program of BPF that asks about new threads, and naps from now on; Python's last until a time."""
    ask, allow = (_RETURN, 0, 0, _ASK), (_RETURN, 0, 0, _ALLOW)
    steps = [
        (_LOAD, 0, 0, _AUDIT_AT),
        (_EQUAL, 0, 7, machine.audit),
        (_LOAD, 0, 0, _NUMBER_AT),
        (_EQUAL, 4, 0, machine.set_robust_list),
        (_EQUAL, 3, 0, machine.nanosleep),
        (_EQUAL, 0, 3, machine.clock_nanosleep),
        (_LOAD, 0, 0, _SECOND_AT),  # the flags
        (_EQUAL, 0, 1, 0),
        ask,
        allow,
    ]
    return b"".join(struct.pack("HBBI", *step) for step in steps)


def _made_by_thread(tid: int) -> bool:
    """Returns whether a thread is not the first one of its process, which may have been made by any process."""
    with contextlib.suppress(OSError):
        return f"\nTgid:\t{tid}\n" not in Path(f"/proc/{tid}/status").read_text()
    return False


def _answer(listener: int, request: int, flags: int) -> None:
    with contextlib.suppress(FileNotFoundError):  # the thread was ended, or a signal came
        fcntl.ioctl(listener, _REPLY, _ANSWER.pack(request, 0, 0, flags))
