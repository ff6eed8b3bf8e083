"""A network for each episode: its ports are its own, and nothing but its own loopback device can be reached.

A small process, the keeper, lives in a user namespace of its own, so that it may make networks (user_namespaces(7)).
It makes sockets in them for this process, and nodes are started in them by nsenter(1). Where the kernel refuses user
namespaces, all episodes share one network. Should this process be killed, the keeper ends what is left of its
episodes.

Its program is text here, because it runs in a bare Python that has none of Simyard's modules, which starts in no time
and takes little memory. The word ``new`` makes a network and answers its handle; ``socket K`` answers a socket in the
Kth, and ``diag K`` one that tells of its connections (sock_diag(7)).
"""

import array
import errno
import functools
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Self

KEEPER = r"""
import array, ctypes, fcntl, os, shutil, socket, struct, sys, time
libc = ctypes.CDLL(None, use_errno=True)
NEW_USER, NEW_NET = 0x10000000, 0x40000000
own, root, uid, gid = socket.socket(fileno=int(sys.argv[1])), sys.argv[2], os.getuid(), os.getgid()

def do(result):
    if result:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))

def answer(text, *handles):
    more = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", handles))] if handles else []
    own.sendmsg([text.encode()], more)

def write(path, text):
    # Who may not map itself stays unmapped: files and signals go by the account that it has outside.
    try:
        with open(path, "w") as file:
            file.write(text)
    except OSError:
        pass

def loopback_up():
    with socket.socket() as any_socket:
        flags, = struct.unpack_from("H", fcntl.ioctl(any_socket, 0x8913, struct.pack("16sH14x", b"lo", 0)), 16)
        fcntl.ioctl(any_socket, 0x8914, struct.pack("16sH14x", b"lo", flags | 1))

def left():
    mark, found = ("ROS_HOME=" + root + "/").encode(), []
    for name in os.listdir("/proc"):
        try:
            if name.isdigit():
                with open(f"/proc/{name}/environ", "rb") as file:
                    if any(each.startswith(mark) for each in file.read().split(b"\0")):
                        found.append(int(name))
        except OSError:
            pass
    return found

def serve():
    networks = []
    do(libc.unshare(NEW_USER))
    write("/proc/self/setgroups", "deny")
    write("/proc/self/uid_map", f"{uid} {uid} 1")
    write("/proc/self/gid_map", f"{gid} {gid} 1")
    answer("ready")
    while True:
        word, _, number = own.recv(64).decode().partition(" ")
        if word == "new":
            do(libc.unshare(NEW_NET))
            loopback_up()
            networks.append(os.open("/proc/self/ns/net", os.O_RDONLY))
            answer("network", networks[-1])
        elif word in ("socket", "diag"):
            do(libc.setns(networks[int(number)], NEW_NET))
            with socket.socket(*(16, 3, 4) if word == "diag" else ()) as made:
                answer(word, made.fileno())
        else:
            return

try:
    serve()
except OSError as exc:
    try:
        answer(f"refused {exc}")
        while own.recv(64):
            answer("refused")
    except OSError:
        pass
# The parent is done with its episodes, or was killed.
for _ in range(100):
    pids = left()
    if not pids:
        break
    for pid in pids:
        try:
            os.kill(pid, 9)
        except OSError:
            pass
    time.sleep(0.01)
shutil.rmtree(root, ignore_errors=True)
"""


_ANSWER_S = 20.0
_SOCK_DIAG = 4


def new_diag() -> socket.socket:
    """Returns what tells of the connections in this process's network."""
    return socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, _SOCK_DIAG)


class EpisodeNetwork:
    """One episode's network.

    Attributes:
        new_socket: Makes a TCP socket in it.
        prefix: What stands before the command of a program that is to run in it.
    """

    def __init__(
        self,
        new_socket: Callable[[], socket.socket],
        prefix: tuple[str, ...],
        handle: int = -1,
        new_diag: Callable[[], socket.socket] = new_diag,
    ) -> None:
        self.new_socket, self.prefix = new_socket, prefix
        self._handle, self._new_diag = handle, new_diag

    @cached_property
    def diag(self) -> socket.socket:
        """Returns what tells of the connections in it."""
        return self._new_diag()

    def close(self) -> None:
        """Gives the network up; it is gone with the last process in it."""
        if "diag" in self.__dict__:
            self.diag.close()
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1


class EpisodeNetworks:
    """Makes networks, or hands out the one that is there.

    Args:
        root: Folder that holds the folders of all episodes.

    Attributes:
        shared: Why all episodes share one network; empty where each has its own.
    """

    def __init__(self, root: Path) -> None:
        self.shared = ""
        self._ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._ours.settimeout(_ANSWER_S)
        command = [sys.executable, "-I", "-S", "-c", KEEPER, str(theirs.fileno()), str(root)]
        self._keeper = subprocess.Popen(  # noqa: S603 - its own program
            command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, start_new_session=True
        )
        theirs.close()
        self._count = 0
        self._say(self._received()[0])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def new(self) -> EpisodeNetwork:
        """Returns a network of its own, or the shared one.

        Raises:
            OSError: The first episodes have networks of their own, and there is no other one.
        """
        if self.shared:
            return EpisodeNetwork(socket.socket, ())
        answer, handle = self._ask("new")
        if handle < 0 and self._count:  # its neighbours have networks of their own: fewer of them may fit
            raise OSError(errno.EMFILE, f"no network for another episode: {answer}")
        self._say(answer)
        if handle < 0:
            return EpisodeNetwork(socket.socket, ())
        number, self._count = self._count, self._count + 1
        new_socket, new_diag = (functools.partial(self._socket, word, number) for word in ("socket", "diag"))
        return EpisodeNetwork(new_socket, self._prefix(handle), handle, new_diag)

    def close(self) -> None:
        """Ends the keeper; what it ends before is what the episodes left."""
        self._ours.close()
        self._keeper.wait()

    def _prefix(self, handle: int) -> tuple[str, ...]:
        keeper, own = self._keeper.pid, os.getpid()
        user, network = f"--user=/proc/{keeper}/ns/user", f"--net=/proc/{own}/fd/{handle}"
        return ("nsenter", user, network, "--preserve-credentials", "--")

    def _socket(self, word: str, number: int) -> socket.socket:
        answer, handle = self._ask(f"{word} {number}")
        if handle < 0:
            raise OSError(errno.EMFILE, f"no socket in an episode's network: {answer}")
        return socket.socket(fileno=handle)

    def _ask(self, question: str) -> tuple[str, int]:
        try:
            self._ours.send(question.encode())
        except OSError as exc:
            return f"refused {exc}", -1
        return self._received()

    def _received(self) -> tuple[str, int]:
        try:
            text, more, _, _ = self._ours.recvmsg(1024, socket.CMSG_SPACE(4), socket.MSG_CMSG_CLOEXEC)
        except OSError as exc:
            return f"refused {exc}", -1
        handles = array.array("i")
        for _, _, data in more:
            handles.frombytes(data[: handles.itemsize])
        return text.decode() or "refused its keeper ended", handles[0] if handles else -1

    def _say(self, answer: str) -> None:
        if answer.startswith("refused"):
            why = answer.removeprefix("refused").strip()
            self.shared = f"all episodes share one network: this kernel gives them none of their own ({why})"
