"""When an application has nothing left to do: what is sent to it next, all of its nodes find in the same state.

Its threads must have slept at one moment, no request of its nodes may be under way, and three kinds of sleepers need
more: one that was sent something and has not noticed; one that polls, which must have looked once more; and one that
sleeps by the wall's clock within a callback.
"""

from collections import Counter
from enum import Enum
from typing import NamedTuple

from tasks.ros.lockstep.exchange import GraphSide
from tasks.ros.process.application_processes import ApplicationProcesses
from tasks.ros.process.thread_watch import Rest, keeps_timers

# What is sent over the loopback device wakes its reader at once, unless that reader waits for something else.
_UNNOTICED_S = 0.02
# roscpp polls simulated time each millisecond, rospy.wait_for_message the wall's each 10; rospy.spin wakes each 500.
_POLL_S = 0.06
_POLLS = 4
_MISSED_POLLS = 4.0
_MISSED_S = 0.025
# How soon to ask again whether one polled, in its periods: whoever asks takes the core that it may wait for.
_PEEK = 0.4
# A thread that is given up again and again is taken back later and later, for each time costs _MISSED_S.
_MOST_POLLS = 64
_AGAIN_S = 0.0003
_REST_KEPT_S = 0.25
# A limit takes so many times as long at most, however busy the machine is.
_LONGEST_LIMIT = 5.0
_TOLD = 3


class IdleState(Enum):
    """What a look found."""

    QUIET = "quiet"
    SOON = "soon"
    AWAKE = "awake"
    WAITS = "waits"
    STOPPED = "stopped"


class _Lapse(NamedTuple):
    """A thread that polled and was given up: when, how often it had been run by then, and when to take it back."""

    period_s: float
    at_s: float
    runs: int
    polls: int


class IdleDetector:
    """Judges one application.

    Args:
        application: Its processes.
        graph: Its own.
        nap_s: As long as its callbacks may sleep, by ``has_time``. What sleeps longer runs by the wall's clock.

    Attributes:
        pollers: Threads that wake up again and again by themselves, with their period in seconds.
        timers: Those of them that look for nothing but simulated time.
        rest_s: When all others slept first since the last ``begin``.
        next_s: When it is worth to look again at an application that waits.
        suspect: Whether threads came, or were run while nothing was to be done: some may have begun to poll.
    """

    def __init__(self, application: ApplicationProcesses, graph: GraphSide, nap_s: float) -> None:
        self.pollers: dict[int, float] = {}
        self.timers: set[int] = set()
        self.rest_s = self.next_s = 0.0
        self.suspect = False
        self._nap_s = nap_s
        self.application, self.graph = application, graph
        self._watch = application.watch
        self._sleepers: frozenset[int] = frozenset()
        self._begun_s = self._base_s = 0.0
        self._served = -1
        self._begun_runs: dict[int, bytes] = {}
        self._noted = False
        self._base: dict[int, bytes] | None = None
        self._due: dict[int, float] = {}
        self._lapses: dict[int, _Lapse] = {}
        self._counted: tuple[float, dict[int, int]] = (0.0, {})
        self._known: frozenset[int] = frozenset()
        self._looked_s = self._idle_s = 0.0
        self._idle_runs: Counter[int] = Counter()

    def begin(self, now_s: float, *, fresh: bool, ticked: bool) -> None:
        """Notes that something is sent now.

        Args:
            now_s: By a clock that only grows.
            fresh: Whether the last look was a moment ago.
            ticked: Whether it is simulated time.
        """
        if not fresh:
            self.application.find()
            self._watch.snapshot()
            self._note_rest(now_s)
        elif not self._noted:  # the application was late: what its threads waited until now is no later message's
            self._watch.snapshot()
        self._watch.mark()
        self._begun_s, self._begun_runs = now_s, self._watch.runs
        self._base, self.rest_s = None, 0.0
        self._due = {tid: s for tid, s in self.pollers.items() if ticked or tid not in self.timers}

    def look(self, now_s: float) -> IdleState:
        """Returns whether the application is quiet; requests must have been served since the look before."""
        self._noted = False
        if self._base is not None and not self._peek(now_s):
            return IdleState.WAITS
        self._looked_s = now_s
        self.application.find()
        noted, rest, served = self._watch.runs, self._watch.look(), self.graph.served
        heard, self._served = served != self._served, served
        self._noted = rest is not Rest.AWAKE
        if self._lapses:
            self._take_back(now_s)
        if self.graph.busy or (rest is Rest.AWAKE and self._watch.awake() not in self.pollers):
            self._base = None
            return IdleState.AWAKE
        if heard or self._watch.changed - self.pollers.keys():
            self._base = None
            return IdleState.SOON
        if rest is Rest.AWAKE:
            self.next_s = now_s + _AGAIN_S
            return IdleState.WAITS
        self.rest_s = self.rest_s or now_s
        if self._due and not self._polled(now_s, noted):
            return IdleState.WAITS
        return self._rested(rest, now_s)

    def _rested(self, rest: Rest, now_s: float) -> IdleState:
        """Returns whether nobody sleeps who has not noticed what was sent, or naps within a callback."""
        waited_s, self.next_s = now_s - self._begun_s, now_s + _AGAIN_S
        if waited_s < _UNNOTICED_S and not self._watch.moved(self.pollers.keys()):
            return IdleState.WAITS
        napping = self._watch.napping(self._sleepers | self.pollers.keys())
        if napping is None:
            return IdleState.SOON
        if napping and self.has_time(self._nap_s, now_s):
            return IdleState.WAITS
        if napping and self._begin_to_poll(napping, waited_s):
            return IdleState.SOON
        self._sleepers |= napping
        return IdleState.STOPPED if rest is Rest.STOPPED else IdleState.QUIET

    def has_time(self, limit_s: float, now_s: float) -> bool:
        """Returns whether the application could run for less than a limit since the last ``begin``.

        What one of its threads waited for a core at most does not count: it is not the application's doing.
        """
        took_s = now_s - self._begun_s
        if took_s < limit_s:
            return True
        return took_s < _LONGEST_LIMIT * limit_s and took_s - self._watch.waited_s(self._begun_runs) < limit_s

    def restless(self, now_s: float) -> str:
        """Returns which threads were run most since the last ``begin``, whose, where and how often, for a person."""
        self._watch.snapshot()
        took_s, counts = now_s - self._begun_s, self._watch.counts_since_mark()
        awake = self._watch.awake()
        most = sorted(counts, key=lambda tid: (tid == awake, counts[tid]), reverse=True)[:_TOLD]
        told = [self._told(tid, counts[tid] / took_s) for tid in most if counts[tid] or tid == awake]
        return "; ".join(
            [each for each in told if each] + ["a request to the master is under way"] * bool(self.graph.busy)
        )

    def _told(self, tid: int, rate_hz: float) -> str:
        pid, doing = self._watch.process(tid), self._watch.doing(tid)
        if not doing:
            return ""
        whose = self.application.node_of(pid) or f"process {pid}"
        which = "main thread" if pid == tid else f"thread {tid}"
        return f"{whose}, {which}: {doing}, ran {_shown(rate_hz)} times a second"

    def count(self, now_s: float) -> None:
        """Begins to count how often threads run although nothing is sent to them."""
        self._watch.snapshot()
        self._counted = (now_s, self._watch.counts())

    def find_pollers(self, now_s: float) -> None:
        """Notes which threads ran again and again since ``count``, and which sleep by the wall's clock for longer."""
        begun_s, before = self._counted
        self._watch.snapshot()
        for tid, count in self._watch.counts().items():
            runs = count - before.get(tid, count)
            if runs >= _POLLS and (now_s - begun_s) / runs < _POLL_S:
                self._add_poller(tid, (now_s - begun_s) / runs)
        self._known, self.suspect = frozenset(self._watch.runs), False

    def sleeps_on(self) -> bool:
        """Returns whether a thread has slept by the wall's clock ever since ``count``; ``rospy.spin`` wakes again."""
        self._watch.snapshot()
        before, now = self._counted[1], self._watch.counts()
        return any(before.get(tid) == now.get(tid) for tid in self._watch.sleepers())

    def find_sleepers(self) -> None:
        """Notes which threads sleep by the wall's clock while nothing is to be done, as ``rospy.spin`` does."""
        self._sleepers = self._watch.sleepers()

    def _begin_to_poll(self, napping: frozenset[int], waited_s: float) -> bool:
        """Returns whether some of those that nap for too long poll: all wait for them from now on."""
        counts = self._watch.counts_since_mark()
        found = {tid: waited_s / counts[tid] for tid in napping if counts.get(tid, 0) >= _POLLS}
        for tid in [tid for tid, period_s in found.items() if period_s < _POLL_S]:
            self._add_poller(tid, found[tid])
            self._due[tid], self._base = found[tid], None
        return bool(found.keys() & self.pollers.keys())

    def _add_poller(self, tid: int, period_s: float) -> None:
        self.pollers[tid] = period_s
        if keeps_timers(self._watch.process(tid), tid):
            self.timers.add(tid)
        self._watch.put_first(self.pollers.keys())

    def _note_rest(self, now_s: float) -> None:
        """Notes which threads were run since the last look, when the application was taken for quiet."""
        if self._idle_s > _REST_KEPT_S:
            self._idle_s = 0.0
            self._idle_runs.clear()
        self._idle_s += now_s - self._looked_s
        self._idle_runs.update(self._watch.changed - self.pollers.keys())
        often = any(runs >= _POLLS and self._idle_s / runs < _POLL_S for runs in self._idle_runs.values())
        self.suspect = self.suspect or often or not self._watch.runs.keys() <= self._known

    def _polled(self, now_s: float, noted: dict[int, bytes]) -> bool:
        """Returns whether each thread that polls had looked once more before this look, and slept again.

        Args:
            now_s: By a clock that only grows.
            noted: What was noted of each thread at the look before. Whom a thread wakes that polls during a look, that
                look may have missed.
        """
        if self._base is None:
            self._base, self._base_s = {tid: self._watch.runs.get(tid, b"") for tid in self._due}, now_s
            self.next_s = now_s + _PEEK * min(self._due.values())
            return False
        self.next_s = now_s
        return all(noted.get(tid) != runs for tid, runs in self._base.items() if tid in self._due)

    def _peek(self, now_s: float) -> bool:
        """Returns whether each thread that polls was run since all others slept; asks no others, so it costs little."""
        base, waited_s = self._base or {}, now_s - self._base_s
        for tid, period_s in list(self._due.items()):
            # Asked before whether it ran: one that sleeps, and did not run after all, waited for no core in between.
            waits = waited_s < max(_MISSED_S, _MISSED_POLLS * period_s) or self._watch.waits_for_core(tid)
            if self._watch.ran(tid, base.get(tid)):
                continue
            if waits:
                self.next_s = now_s + _PEEK * period_s
                return False
            self._give_up(tid, now_s)
        return True

    def _give_up(self, tid: int, now_s: float) -> None:
        """Waits no more for a thread that does not poll any more, as it seems."""
        del self._due[tid]
        before, runs = self._lapses.get(tid), self._watch.counts().get(tid, 0)
        polls = min(2 * before.polls, _MOST_POLLS) if before is not None else _POLLS
        self._lapses[tid] = _Lapse(self.pollers.pop(tid), now_s, runs, polls)

    def _take_back(self, now_s: float) -> None:
        """Waits again for threads that were given up, and have polled since: nobody rests whom one of them wakes."""
        counts = self._watch.counts()
        for tid in self._lapses.keys() - self.pollers.keys():
            lapse = self._lapses[tid]
            runs = counts.get(tid, 0) - lapse.runs
            if runs < lapse.polls:
                continue
            if (now_s - lapse.at_s) / runs < _POLL_S:
                self._add_poller(tid, lapse.period_s)
                self._due[tid], self._base = lapse.period_s, None
            else:  # it slept for long: what it does from now on says whether it polls
                self._lapses[tid] = lapse._replace(at_s=now_s, runs=counts.get(tid, 0))


def _shown(rate_hz: float) -> str:
    """Returns a rate with two digits, as a number without an exponent."""
    return f"{float(f'{rate_hz:.2g}'):g}"
