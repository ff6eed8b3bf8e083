"""One episode's application: its processes, started as roslaunch would, watched, and ended for certain.

An episode's processes are found as children of its nodes, by the session that a node leads, and, once they have
neither, by the ``ROS_HOME`` in their environment: whoever their parent is by now.
"""

import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import NamedTuple

from tasks.ros.launch.launch_plan import NodePlan, node_stem, results_file
from tasks.ros.process.lane_limits import LaneLimits, ending
from tasks.ros.process.nap_gate import NapGate
from tasks.ros.process.thread_watch import ThreadWatch

_PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 36, 37
_LOADAVG_BYTES = 64


class _Adoption:
    """Makes this process the parent of its descendants' orphans for as long as anybody needs it.

    It is taken back at the end: a process that is given orphans may be asked by others, such as a robot's agent, to end
    all that it did not start.
    """

    def __init__(self) -> None:
        self._lock, self._holders, self._before = threading.Lock(), 0, 0

    @property
    def alone(self) -> bool:
        """Returns whether one holder needs it, and no other."""
        return self._holders == 1

    def begin(self) -> None:
        with self._lock:
            if not self._holders:
                asked = ctypes.c_int()
                ctypes.CDLL(None).prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(asked), 0, 0, 0)
                self._before = asked.value
                ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
            self._holders += 1

    def end(self) -> None:
        with self._lock:
            self._holders -= 1
            if not self._holders:
                ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, self._before, 0, 0, 0)


_ADOPTION = _Adoption()


class ProcessTracker:
    """The processes of all episodes that this process runs; until it is closed, their orphans are this process's.

    So what calls ``setsid`` cannot get away.

    Begun when this process has all its own children that lead a session: others that are started later, and do, are
    taken for orphans of nodes.

    Attributes:
        epoch: Grows when a process or thread was started anywhere on the machine since the last ``update``.
    """

    def __init__(self) -> None:
        _ADOPTION.begin()
        self.epoch = 0
        self._own_children = frozenset(each.pid for each in _children())
        self._begun_ticks = int(time.clock_gettime(time.CLOCK_BOOTTIME) * os.sysconf("SC_CLK_TCK"))
        self._of: dict[int, Path] = {}
        self._seen: set[int] = set()
        self._newest = b""
        self._loadavg = os.open("/proc/loadavg", os.O_RDONLY)

    def add(self, pid: int, home: Path) -> None:
        """Counts a node that was just started among the processes of an episode."""
        self._of[pid] = home
        self._newest = b""

    def update(self) -> None:
        """Looks for processes that are new; quick as long as nothing was started on this machine."""
        newest = os.pread(self._loadavg, _LOADAVG_BYTES, 0).rpartition(b" ")[2]
        if newest == self._newest:
            return
        self._newest, self.epoch = newest, self.epoch + 1
        there = _process_ids()
        for pid in self._of.keys() - there:
            del self._of[pid]
        # A parent is older than its child; numbers start again at the smallest one some day, and two rounds see that.
        new = sorted(there - self._seen)
        for pid in (*new, *new):
            if pid not in self._of:
                self._place(pid)
        self._seen = there

    def processes(self, home: Path) -> list[int]:
        """Returns the processes of an episode as of the last update."""
        return [pid for pid, each in self._of.items() if each == home]

    def strays(self) -> list[int]:
        """Returns the orphans that this process adopted and nobody knows: its new children in a session of their own.

        A node's orphan may have left its session and its mark behind; a session of this process's it cannot enter. As
        long as others have episodes in this process, theirs are not told apart: there are none then.
        """
        if not _ADOPTION.alone:
            return []
        session = os.getsid(0)
        return [
            each.pid
            for each in _children()
            if each.session != session and each.begun_ticks >= self._begun_ticks and each.pid not in self._own_children
        ]

    def forget(self, homes: Iterable[Path]) -> None:
        """Forgets the processes of episodes that are over."""
        gone = set(homes)
        self._of = {pid: home for pid, home in self._of.items() if home not in gone}

    def close(self) -> None:
        """Closes the file, and adopts no more."""
        if self._loadavg >= 0:
            os.close(self._loadavg)
            self._loadavg = -1
            _ADOPTION.end()

    def _place(self, pid: int) -> None:
        with contextlib.suppress(OSError, IndexError, ValueError):
            fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
            parent, session = int(fields[1]), int(fields[3])
            home = self._of.get(parent) or self._of.get(session)
            if home is None and parent in (os.getpid(), 1):
                home = next((each for each in set(self._of.values()) if has_home(pid, each)), None)
            if home is not None:
                self._of[pid] = home


def has_home(pid: int, home: Path) -> bool:
    """Returns whether a process, whoever its parent is, has an episode's folder as its ROS_HOME."""
    with contextlib.suppress(OSError):
        return f"ROS_HOME={home}".encode() in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    return False


def marked(homes: Iterable[Path]) -> list[int]:
    """Returns the processes of episodes that ``/proc`` shows now, by their environment; zombies have none."""
    marks = {f"ROS_HOME={home}".encode() for home in homes}
    found: list[int] = []
    for pid in _process_ids():
        with contextlib.suppress(OSError):
            if not marks.isdisjoint(Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")):
                found.append(pid)
    return found


def alive(pid: int) -> bool:
    """Returns whether a process runs or sleeps: a zombie does neither."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[0] not in (b"Z", b"X")
    return False


class _Child(NamedTuple):
    pid: int
    session: int
    begun_ticks: int


def _children() -> list[_Child]:
    """Returns this process's children; zombies are none."""
    found: list[_Child] = []
    for pid in _process_ids():
        with contextlib.suppress(OSError, IndexError, ValueError):
            fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
            if int(fields[1]) == os.getpid() and fields[0] not in (b"Z", b"X"):
                found.append(_Child(pid, int(fields[3]), int(fields[19])))
    return found


def _process_ids() -> set[int]:
    return {int(name) for name in os.listdir("/proc") if name.isdigit()}  # noqa: PTH208 - much quicker


_ROUNDS = 500
_PAUSE_S = 0.002
_LOG_END_BYTES = 2000
_RESULTS_BYTES = 64 << 10
_LAST_WORDS_CHARACTERS = 300


def tied_to(parent: int) -> tuple[str, ...]:
    """Returns what stands before a command that is to be killed when a process is, whose child it is.

    Entering a network would undo it, and comes before. A process that was killed earlier is no parent any more, and
    nothing is run.
    """
    return "setpriv", "--pdeathsig", "KILL", "--", "sh", "-c", '[ "$PPID" = "$0" ] && exec "$@"', str(parent)


class _Node(NamedTuple):
    plan: NodePlan
    process: "subprocess.Popen[bytes]"
    log: Path


class ApplicationProcesses:
    """The processes of one episode.

    Args:
        home: Its folder, made by ``make_home``.
        tracker: Of all episodes.
        limits: How much it may use.
        gate: Holds naps of its threads; by default nobody does.

    Attributes:
        watch: Its threads.
        gate: Of their naps.
        done: Names of nodes that ended as they should.
        simulation_failed: Whether the node that ended, and should not have, is the simulation application's.
    """

    def __init__(self, home: Path, tracker: ProcessTracker, limits: LaneLimits, gate: NapGate | None = None) -> None:
        self.home, self.watch, self.gate = home, ThreadWatch(), gate or NapGate()
        self._tracker, self._limits = tracker, limits
        self._nodes: list[_Node] = []
        self.done: set[str] = set()
        self.simulation_failed = False
        self._passed: dict[str, bool] = {}
        self._seen: set[str] = set()
        self._printed = ""
        self._epoch = -1

    def start(self, plans: Iterable[NodePlan], environment: Mapping[str, str], prefix: Sequence[str] = ()) -> None:
        """Starts nodes.

        Args:
            plans: The nodes.
            environment: Of the whole application.
            prefix: What stands before each command.
        """
        for plan in plans:
            log = self.home / "log" / f"{node_stem(plan.name)}.out"
            with log.open("wb") as out, self.gate.door() as door:
                process = subprocess.Popen(  # noqa: S603 - as roslaunch resolved it
                    [*prefix, *tied_to(os.getpid()), *self._limits.command(), *door.command, *plan.command],
                    env={**environment, **plan.own_environment()},
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=subprocess.STDOUT,
                    cwd=plan.cwd or self.home,
                    start_new_session=True,
                    pass_fds=door.files,
                )
            self._nodes.append(_Node(plan, process, log))
            self._tracker.add(process.pid, self.home)

    @property
    def names(self) -> frozenset[str]:
        """Returns the names of those nodes that run."""
        return frozenset(each.plan.name for each in self._nodes if each.plan.named) - self.done

    @property
    def anonymous(self) -> bool:
        """Returns whether a process runs of which nobody knows which nodes it starts."""
        return any(not each.plan.named and each.plan.name not in self.done for each in self._nodes)

    def failure(self) -> str:
        """Returns which node ended that should not have, for a person; empty as long as none did.

        A node that ends with status 0 has done its work, unless the launch file says otherwise.
        """
        for node in self._nodes:
            if node.plan.name in self.done or node.process.poll() is None:
                continue
            status = int(node.process.returncode)
            if node.plan.judges:
                self.done.add(node.plan.name)
                results = results_file(self.home, node.plan.name)
                self._passed[node.plan.name] = status == 0 and not _has_failures(results)
                continue
            if status == 0 and not node.plan.required and not node.plan.respawn:
                self.done.add(node.plan.name)
                continue
            why = ""
            if node.plan.required:
                why = ", and is required"
            elif node.plan.respawn:
                why = ", and would be respawned: that is not done in lock-step"
            self.simulation_failed = node.plan.simulation
            return f"node {node.plan.name} {ending(status)}{why}{self._last_words(node)}"
        return ""

    def tests_passed(self) -> bool | None:
        """Returns whether the nodes whose end says so passed; None before a required one, or all tests, have ended."""
        plans = [each.plan for each in self._nodes if each.plan.judges]
        over = any(plan.required and plan.name in self._passed for plan in plans)
        over = over or all(plan.name in self._passed for plan in plans)
        return all(self._passed.values()) if plans and over else None

    def await_leaving(self, registered: Set[str], limit_s: float) -> None:
        """Waits for some time until nodes have ended that judge and have left: so a test ends at one simulated time.

        Args:
            registered: The nodes that the master knows now.
            limit_s: How long.
        """
        leaving = [each for each in self._nodes if each.plan.judges and each.plan.name not in self.done]
        leaving = [each for each in leaving if each.plan.name in self._seen and each.plan.name not in registered]
        self._seen |= registered
        ends_s = time.perf_counter() + limit_s
        while any(each.process.poll() is None for each in leaving) and time.perf_counter() < ends_s:
            self.gate.let_go({each.process.pid for each in leaving})
            time.sleep(_PAUSE_S)

    def last_failure(self, limit_s: float) -> str:
        """Returns which node ended that should not have, as ``failure`` does, and waits for some time that one ends."""
        ends_s, found = time.perf_counter() + limit_s, self.failure()
        while not found and (self.names or self.anonymous) and time.perf_counter() < ends_s:
            self.gate.let_go({each.process.pid for each in self._nodes})
            time.sleep(_PAUSE_S)
            found = self.failure()
        return found

    @property
    def ended(self) -> frozenset[int]:
        """Returns the numbers of its nodes' processes that ended, as of the last ``failure``."""
        return frozenset(each.process.pid for each in self._nodes if each.process.returncode is not None)

    def excess(self) -> str:
        """Returns which of its limits the application is beyond; empty while it keeps them all."""
        return self._limits.excess(self.processes(), self.home)

    def processes(self) -> list[int]:
        """Returns its processes as of the last ``find``."""
        return self._tracker.processes(self.home)

    def find(self) -> None:
        """Looks which processes and threads there are, if any were started since it looked last."""
        self._tracker.update()
        if self._tracker.epoch != self._epoch:
            self._epoch = self._tracker.epoch
            self.watch.refresh(self.processes())

    def found(self) -> list[int]:
        """Returns its processes as of now."""
        self.find()
        return self.processes()

    def node_of(self, pid: int) -> str:
        """Returns the name of the node that a process belongs to: that node leads its session; empty for an orphan."""
        with contextlib.suppress(OSError):
            session = os.getsid(pid)
            return next((each.plan.name for each in self._nodes if each.process.pid == session), "")
        return ""

    def stopped(self) -> str:
        """Returns which node was stopped by a signal, as ``kill -STOP`` does, for a person."""
        names = [each.plan.name for each in self._nodes if _state(each.process.pid) in ("T", "t")]
        return f"node {names[0]} was stopped by a signal" if names else "a process was stopped by a signal"

    def kill(self) -> None:
        """Kills what is known of it; ``end_all`` makes sure."""
        for pid in {*self.processes(), *(each.process.pid for each in self._nodes if each.process.poll() is None)}:
            end_process(pid)

    def reap(self) -> None:
        """Waits for its nodes, which were killed."""
        for each in self._nodes:
            each.process.wait()
        self._printed = self.printed()
        self.watch.close()
        self.gate.close()

    def printed(self) -> str:
        """Returns what its nodes printed last, each line after its node's name; known when its folder is gone, too."""
        if self._printed:
            return self._printed
        both, said = len({node.plan.simulation for node in self._nodes}) > 1, list[str]()
        for simulation, head in ((False, "robot application:"), (True, "simulation application:")):
            lines = [*self._lines(simulation=simulation)]
            said += [head, *lines] if both and lines else lines
        return "\n".join(said)

    def _lines(self, *, simulation: bool) -> Iterator[str]:
        """Yields what the nodes of an application printed last, and the results of its tests."""
        for node in self._nodes:
            if node.plan.simulation is simulation:
                yield from (f"{node.log.stem}: {line}" for line in _log_end(node.log))
                if node.plan.test:
                    results = results_file(self.home, node.plan.name)
                    yield from (f"{results.name}: {line}" for line in _log_end(results, _RESULTS_BYTES))

    def _last_words(self, node: _Node) -> str:
        """Returns the last line that a node wrote, if it wrote any."""
        lines = [line.strip() for line in _log_end(node.log) if line.strip()]
        return f": {lines[-1][:_LAST_WORDS_CHARACTERS]}" if lines else ""


def _has_failures(results: Path) -> bool:
    """Returns whether a test's results, as JUnit has them, name a failure or an error."""
    text = "\n".join(_log_end(results, _RESULTS_BYTES))
    return "<failure" in text or "<error" in text


def _log_end(path: Path, most_bytes: int = _LOG_END_BYTES) -> list[str]:
    """Returns the last lines that a node wrote."""
    # A node may have put anything in its log's place: a pipe that nobody writes to would be waited for.
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK
    with contextlib.suppress(OSError), os.fdopen(os.open(path, flags), "rb") as log:
        log.seek(max(0, os.fstat(log.fileno()).st_size - most_bytes))
        return log.read(most_bytes).decode(errors="replace").strip().splitlines()
    return []


def end_applications(applications: Sequence[ApplicationProcesses], tracker: ProcessTracker) -> None:
    """Ends everything that some episodes ever started, and removes their folders."""
    homes = [each.home for each in applications]
    known: set[int] = set()
    for _ in range(_ROUNDS):
        tracker.update()
        for each in applications:
            each.kill()
        left = [pid for pid in marked(homes) if alive(pid)]
        known.update(left, *(each.processes() for each in applications))
        if not left and not any(alive(pid) for each in applications for pid in each.processes()):
            break
        for pid in left:
            end_process(pid)
        time.sleep(_PAUSE_S)
    for each in applications:
        each.reap()
    for pid in known:
        # Orphans are this process's to reap: it adopted them.
        with contextlib.suppress(ChildProcessError):
            os.waitpid(pid, os.WNOHANG)
    tracker.forget(homes)
    for home in homes:
        shutil.rmtree(home, ignore_errors=True)


def end_strays(tracker: ProcessTracker) -> None:
    """Ends what got away from every episode: no parent, no session and no mark tell whose it is.

    Only when all episodes are over: until then such a process is one of theirs.
    """
    for _ in range(_ROUNDS):
        strays = tracker.strays()
        for pid in strays:
            end_process(pid)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, os.WNOHANG)
        if not strays:
            return
        time.sleep(_PAUSE_S)


def end_process(pid: int) -> None:
    """Kills a process; nothing happens to one that is gone, or that has become somebody else's."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(pid, signal.SIGKILL)


def _state(pid: int) -> str:
    with contextlib.suppress(OSError, IndexError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    return ""
