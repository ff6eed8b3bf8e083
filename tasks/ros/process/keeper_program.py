"""The keeper's program: it makes networks and sockets in them, and outlives its parent to end what that leaves.

It is text here, because it runs in a bare Python that has none of Simyard's modules, which starts in no time and
takes little memory. The word ``new`` makes a network and answers its handle; ``socket K`` answers a socket in the
Kth.
"""

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
        elif word == "socket":
            do(libc.setns(networks[int(number)], NEW_NET))
            with socket.socket() as made:
                answer("socket", made.fileno())
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
