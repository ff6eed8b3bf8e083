"""What a process does to itself before it imports an application: limits of memory, files and processes, and a wall.

``python -m tasks.simulate.sandbox.self_confinement RULES MODULE ARGUMENTS`` applies the rules, then runs the module in
their force, from which nothing leads back. It imports the standard library alone: whatever starts a thread before the
wall stands would stay outside of it. What cannot be applied ends the process, which then has run nothing.

The wall is for where bubblewrap is not. Landlock (landlock(7)) lets files be read and written below the folders that
the rules name, and no process be looked into or, from Linux 6.12 on, signalled that stands outside. It knows neither
sockets of other programs nor modes of files: a filter of system calls (seccomp(2)) refuses these, and the network
unless the process gets a network of its own, which the kernel gives whom it lets make user namespaces.
"""

import ctypes
import fcntl
import json
import os
import platform
import resource
import runpy
import socket
import struct
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple, TypedDict

PROBE = "probe"
"""As the module: the rules are applied, and nothing is run; what is printed is ``OWN_NETWORK``, if there is one."""
OWN_NETWORK = "network"
_OWN = "tasks.simulate.sandbox.self_confinement"


class _Rules(TypedDict):
    limits: Mapping[str, int]
    readable: Sequence[str] | None
    writable: Sequence[str]
    listable: Sequence[str]


def self_confined(
    module: str,
    arguments: Sequence[str],
    *,
    limits: Mapping[str, int],
    readable: Sequence[str] | None = None,
    writable: Sequence[str] = (),
    listable: Sequence[str] = (),
) -> list[str]:
    """Returns the arguments of Python with which a module runs confined by itself.

    Args:
        module: As for ``python -m``.
        arguments: Its own.
        limits: By their names in ``resource``, such as ``RLIMIT_FSIZE``.
        readable: Files and folders that it may read and run; None builds no wall.
        writable: Those that it may also write.
        listable: Folders in and below which it may read names, as Python does where modules lie.
    """
    rules: _Rules = {"limits": limits, "readable": readable, "writable": writable, "listable": listable}
    return ["-m", _OWN, json.dumps(rules), module, *arguments]


class _Machine(NamedTuple):
    """Numbers that a kind of processor has of its own: for seccomp(2), and of system calls.

    Attributes:
        audit: What seccomp calls it.
        socket, socketpair: Of these calls.
        modes: Of the calls that change who may use a file, by its path: Landlock lets them pass.
    """

    audit: int
    socket: int
    socketpair: int
    modes: tuple[int, ...]


_MODES_ANYWHERE = (452, 463, 466)  # fchmodat2, setxattrat, removexattrat
_MACHINES = {
    "x86_64": _Machine(0xC000003E, 41, 53, (90, 92, 94, 260, 268, 188, 189, 197, 198, *_MODES_ANYWHERE)),
    "aarch64": _Machine(0xC00000B7, 198, 199, (53, 54, 5, 6, 14, 15, *_MODES_ANYWHERE)),
}
_IO_URING_SETUP, _OTHER_CALLS = 425, 0x40000000  # from the second on: calls of x32
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_SET_SECCOMP, _NO_NEW_PRIVILEGES, _FILTER = 22, 38, 2
_NEW_USER, _NEW_NET = 0x10000000, 0x40000000
# Before the third, whoever may not write a file may still cut it short.
_LEAST_LANDLOCK = 3
_IOCTL_SINCE, _SCOPE_SINCE = 5, 6
# Rights to files, as bits: to run, read and list; to list; all to a file that is no folder; all of the third version.
_READ, _LIST, _FILE, _ALL, _IOCTL = 0b1101, 0b1000, 0b111 | 1 << 14, (1 << 15) - 1, 1 << 15
_SCOPES = 0b11  # abstract sockets, signals
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050001  # with EPERM
_LOAD, _EQUAL, _AT_LEAST, _AND, _RETURN = 0x20, 0x15, 0x35, 0x54, 0x06
_NUMBER, _AUDIT, _FIRST, _SECOND = 0, 4, 16, 24
_DATAGRAM, _KIND_OF_SOCKET = 2, 0xF


def apply_rules(rules: _Rules) -> bool:
    """Confines this process, which has one thread, and returns whether it has a network of its own behind the wall.

    Raises:
        OSError: The kernel does not do it.
    """
    for name, most in rules["limits"].items():
        _limit(getattr(resource, name), most)
    readable = rules["readable"]
    if readable is None:
        return False
    own_network = _may_take_network() and _take_network()
    _do(_libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0), "PR_SET_NO_NEW_PRIVS")
    _build_wall({_READ: readable, _ALL: rules["writable"], _LIST: rules["listable"]})
    _filter_calls(own_network=own_network)
    return own_network


_libc = ctypes.CDLL(None, use_errno=True)


def _do(result: int, what: str) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), f"{what}: {os.strerror(ctypes.get_errno())}")
    return result


def _limit(kind: int, most: int) -> None:
    _, hard = resource.getrlimit(kind)
    found = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (found, found))


def _may_take_network() -> bool:
    """Returns whether a child gets a network: Ubuntu's AppArmor gives one that cannot be switched on."""
    child = os.fork()
    if not child:
        taken = False
        try:
            taken = _take_network()
        finally:
            os._exit(not taken)
    return os.waitpid(child, 0)[1] == 0


def _take_network() -> bool:
    """Returns whether this process is in a new network now, which has a loopback device and nothing else."""
    uid, gid = os.getuid(), os.getgid()
    if _libc.unshare(_NEW_USER | _NEW_NET):
        return False
    for name, text in (("setgroups", "deny"), ("uid_map", f"{uid} {uid} 1"), ("gid_map", f"{gid} {gid} 1")):
        # Who may not map itself stays unmapped: files and signals go by the account that it has outside.
        with suppress(OSError), open(f"/proc/self/{name}", "w", encoding="ascii") as file:  # noqa: PTH123 - no pathlib
            file.write(text)
    with socket.socket() as any_socket:
        device = struct.pack("16sH14x", b"lo", 0)
        (flags,) = struct.unpack_from("H", fcntl.ioctl(any_socket, 0x8913, device), 16)
        fcntl.ioctl(any_socket, 0x8914, struct.pack("16sH14x", b"lo", flags | 1))
    return True


def _build_wall(doors: Mapping[int, Sequence[str]]) -> None:
    """Takes all rights to files from this process but those of the doors, whose keys are rights."""
    version = _do(_libc.syscall(_CREATE_RULESET, None, 0, 1), "Landlock")
    if version < _LEAST_LANDLOCK:
        raise OSError(f"Landlock of version {version}: at least {_LEAST_LANDLOCK} (Linux 6.2)")
    every = _ALL | (_IOCTL if version >= _IOCTL_SINCE else 0)
    handled = [every, 0, _SCOPES] if version >= _SCOPE_SINCE else [every]
    ruleset = struct.pack(f"{len(handled)}Q", *handled)
    wall = _do(_libc.syscall(_CREATE_RULESET, ruleset, len(ruleset), 0), "Landlock")
    for rights, paths in doors.items():
        for path in paths:
            _open_wall(wall, path, every if rights == _ALL else rights)
    _do(_libc.syscall(_RESTRICT_SELF, wall, 0), "Landlock")
    os.close(wall)


def _open_wall(wall: int, path: str, rights: int) -> None:
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except (FileNotFoundError, PermissionError):  # what is not there, or not for this account, needs no door
        return
    allowed = rights if os.path.isdir(path) else rights & (_FILE | _IOCTL)  # noqa: PTH112 - no pathlib
    _do(_libc.syscall(_ADD_RULE, wall, 1, struct.pack("=Qi", allowed, place), 0), f"Landlock: {path}")
    os.close(place)


def _filter_calls(*, own_network: bool) -> None:
    """Refuses sockets of other programs, those of a network that is not the process's own, and changes of modes."""
    machine = _MACHINES.get(platform.machine())
    if machine is None:
        raise OSError(f"no filter of system calls for {platform.machine()}")
    kinds = (socket.AF_INET, socket.AF_INET6, 16) if own_network else ()  # 16: netlink, by which a network is asked
    refused = (*machine.modes, _IO_URING_SETUP)
    steps = [(_LOAD, _AUDIT), (_EQUAL, machine.audit, "", "refuse"), (_LOAD, _NUMBER)]
    steps += [(_AT_LEAST, _OTHER_CALLS, "refuse", "")] if platform.machine() == "x86_64" else []
    steps += [(_EQUAL, number, "refuse", "") for number in refused]
    steps += [(_EQUAL, machine.socket, "socket", ""), (_EQUAL, machine.socketpair, "pair", "allow")]
    # Of two ends that are connected once and for all neither can be connected to another program; of datagrams it can.
    steps += [("pair",), (_LOAD, _SECOND), (_AND, _KIND_OF_SOCKET), (_EQUAL, _DATAGRAM, "refuse", "allow")]
    steps += [("socket",), (_LOAD, _FIRST), *((_EQUAL, int(kind), "allow", "") for kind in kinds)]
    steps += [("refuse",), (_RETURN, _REFUSE), ("allow",), (_RETURN, _ALLOW)]
    code = _assembled(steps)
    program = ctypes.create_string_buffer(code, len(code))
    # A pointer after the count, in the layout of this machine.
    head = struct.pack("HP", len(code) // 8, ctypes.addressof(program))
    _do(_libc.prctl(_SET_SECCOMP, _FILTER, head, 0, 0), "seccomp")


def _assembled(steps: Sequence[tuple[int | str, ...]]) -> bytes:
    """Returns a program of BPF; a step is a mark, or an instruction: its code, its number, where to if so, if not."""
    places: dict[str, int] = {}
    for step in steps:
        if isinstance(step[0], str):
            places[step[0]] = sum(isinstance(each[0], int) for each in steps[: steps.index(step)])
    found = b""
    for number, step in enumerate(each for each in steps if isinstance(each[0], int)):
        ways = [places[str(mark)] - number - 1 if mark else 0 for mark in (step[2:] or ("", ""))]
        found += struct.pack("HBBI", step[0], *ways, step[1])
    return found


if __name__ == "__main__":
    try:
        own_network = apply_rules(json.loads(sys.argv[1]))
    except OSError as exc:
        sys.exit(f"{_OWN}: {exc}")
    if sys.argv[2] == PROBE:
        sys.stdout.write(OWN_NETWORK * own_network)
    else:
        sys.argv = sys.argv[2:]
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
