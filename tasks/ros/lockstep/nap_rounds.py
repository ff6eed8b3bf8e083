"""Whose nap ends next, of those that are held: one thread's at a time, in an order that is the same in each run."""

from collections import Counter
from collections.abc import Set

from tasks.ros.process.nap_gate import HELD_S, NapGate
from tasks.ros.process.thread_watch import Runs, ThreadWatch

# A poll that runs for longer found something. Each time that one does so, twice as much is usual.
_LITTLE_NS = 100_000
_MORE = 2
# Who so often waits for something else after its nap does not rest at the gate.
_OFTEN = 20


class NapRounds:
    """The naps of one application's threads.

    A thread that naps again and again polls. What one finds may depend on what another one did; so the threads of a
    process poll in as many rounds as there are, which holds every order of them, as in ``PollOrders``, and again when
    anybody else was run there. One that was never seen to poll may nap in a callback instead: its naps end, one after
    the other, until it is known.

    Args:
        gate: Holds their naps.
        watch: Of the threads.
        nap_s: As long as a callback may nap.

    Attributes:
        polling: Threads that are known to poll.
        last: The thread whose nap ended last, and may run since; 0 for none.
        touched: Processes in which somebody was run since ``begin``; 0 stands for all.
    """

    def __init__(self, gate: NapGate, watch: ThreadWatch, nap_s: float) -> None:
        self.polling: set[int] = set()
        self._gate, self._watch, self._most = gate, watch, nap_s / HELD_S
        self.begin()

    def begin(self) -> None:
        """Notes that something is sent now, and that whoever naps is at rest."""
        self.last = 0
        self._noted, self._little_ns = b"", _LITTLE_NS
        self._ended, self._away = Counter[int](), Counter[int]()
        self.touched: set[int] = set()
        # How many rounds each process has begun since it was touched, and who is left of the round that is under way.
        self._rounds: dict[int, int] = {}
        self._round: list[int] = []

    def touch(self, pids: Set[int]) -> None:
        """Lets all threads of some processes poll anew: somebody was run there. 0 stands for all processes."""
        self.touched |= pids
        self._rounds = {pid: begun for pid, begun in self._rounds.items() if not pids & {pid, 0}}
        self._round = [tid for tid in self._round if not pids & {self._watch.process(tid), 0}]

    def note_runs(self, tids: Set[int]) -> None:
        """Lets all threads poll anew in whose process one was run that was not let go."""
        if others := tids - {self.last}:
            self.touch({self._watch.process(tid) for tid in others})

    def end_next(self, *, patient: bool) -> bool:
        """Ends the nap of the thread whose turn it is; returns False if all have polled. All threads must sleep.

        Args:
            patient: Whether callbacks still have time to nap.
        """
        self._settle()
        tid = self._next()
        if not tid:
            return False
        self._ended[tid] += 1
        if not patient or self._ended[tid] > self._most:
            self.polling.add(tid)
        self.last, self._noted = tid, self._watch.now(tid)
        self._gate.end(tid)
        return True

    def _settle(self) -> None:
        """Lets all of its process poll anew if the thread that was let go found something."""
        tid, self.last = self.last, 0
        if not tid:
            return
        away = tid not in self._gate.held
        ran_ns = Runs.of(self._watch.now(tid)).ran_ns - Runs.of(self._noted).ran_ns
        if away or (tid in self.polling and ran_ns > self._little_ns):
            self.touch({self._watch.process(tid)})
            self._little_ns *= _MORE
        self._away[tid] += away
        if self._away[tid] > _OFTEN:
            self._gate.free.add(tid)

    def _next(self) -> int:
        while self._round or self._begin_round():
            tid = self._round.pop(0)
            if tid in self._gate.held:
                return tid
        return 0

    def _begin_round(self) -> bool:
        """Begins the next round of the first process that has one left; returns whether any has."""
        threads: dict[int, list[int]] = {}
        for tid in self._gate.in_order():
            threads.setdefault(self._watch.process(tid), []).append(tid)
        for pid, tids in threads.items():
            begun = self._rounds.get(pid, 0)
            if self.touched & {pid, 0} and (begun < len(tids) or not self.polling.issuperset(tids)):
                self._rounds[pid], self._round = begun + 1, tids
                return True
        return False
