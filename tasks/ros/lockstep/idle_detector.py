"""When an application has nothing left to do: what is sent to it next, all of its nodes find in the same state.

Its threads must have slept at one moment, no request of its nodes may be under way, and four kinds of sleepers need
more: one that was sent something and has not noticed; one that polls, which must have looked once more, and have found
nothing (``docs/decisions/0048-polls-that-change-nothing.md``); one whose nap is held, which looks when it is let go
(``docs/decisions/0050-naps-in-order.md``); and one that sleeps by the wall's clock within a callback.
"""

from collections import Counter
from collections.abc import Sequence, Set
from enum import Enum
from typing import NamedTuple

from tasks.ros.lockstep.exchange import GraphSide
from tasks.ros.lockstep.nap_rounds import NapRounds
from tasks.ros.process.application_processes import ApplicationProcesses
from tasks.ros.process.thread_watch import Rest, Runs, keeps_timers

# What is sent over the loopback device wakes its reader at once, unless that reader waits for something else.
_UNNOTICED_S = 0.02
# roscpp polls simulated time each millisecond, rospy.wait_for_message the wall's each 10; rospy.spin wakes each 500.
_POLL_S = 0.06
_POLLS = 4
_LOOKS = 50
_MISSED_POLLS = 4.0
_MISSED_S = 0.025
# A poll that runs for longer than usual found something. Each time that it does so once more, more of it is usual.
_USUAL = 2.0
_USUAL_NS = 20_000.0
# Whoever wakes because its time is over, and finds nothing, runs for less, at times that vary by less.
_LITTLE_NS = 100_000
_IN_TIME = 0.03
_LOOKED = 0.15
_SELDOM_S = 0.6
_FEW = 6
# How soon to ask again whether one polled, in its periods: whoever asks takes the core that it may wait for.
_PEEK = 0.4
# A thread that is given up again and again is taken back later and later, for each time costs _MISSED_S.
_MOST_POLLS = 64
_AGAIN_S = 0.0003
_ASK_S = 0.01
_REST_KEPT_S = 0.25
# Who looks late, because others had the core, did not see the application sleep for all of that time.
_LONGEST_SEEN_S = 0.02
# A limit takes so many times as long at most: a thread that waits for a disk which is gone neither runs nor sleeps.
_LONGEST_LIMIT = 30.0
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


class _Wake(NamedTuple):
    """When a thread ran last: after one look and before the next.

    Attributes:
        after_s, at_s: When these looks were.
        counted: What was counted of it by then.
        gap_s: How long after the time before, without what it waited for a core; 0 where the looks do not tell.
        period_s, usual_ns: How long it sleeps if nobody wakes it, and runs then; 0 for one of which that is not known.
    """

    after_s: float
    at_s: float
    counted: Runs
    gap_s: float = 0.0
    period_s: float = 0.0
    usual_ns: float = 0.0


class PollOrders:
    """In which orders the pollers of one process polled.

    What one of them does, another one may find when it polls next, and a third one what that one does. All have found
    everything once they polled in every order, with nothing done in between. As many rounds as pollers hold every
    order; those who poll often do so in the time that one round takes, so where they are few, sets of them are kept.

    Args:
        pollers: The threads.
    """

    def __init__(self, pollers: Sequence[int]) -> None:
        self._bits = {tid: 1 << number for number, tid in enumerate(pollers)}
        # Of each set of them, by its bits: who polled after all others of the set had polled in every order.
        self._last = [0] * (1 << len(pollers)) if len(pollers) <= _FEW else []
        self._rounds, self._polled = 0, set[int]()

    def add(self, polled: Set[int]) -> None:
        """Notes who polled since the last time, in an order that is not known."""
        bits = [bit for tid, bit in self._bits.items() if tid in polled]
        for those in range(len(self._last) - 1, 0, -1):
            for bit in bits:
                if those & bit and self._last[those ^ bit] == those ^ bit:
                    self._last[those] |= bit
        self._polled |= polled & self._bits.keys()
        if len(self._polled) == len(self._bits):
            self._rounds, self._polled = self._rounds + 1, set()

    @property
    def all_seen(self) -> bool:
        """Returns whether they polled in every order."""
        return self._rounds >= len(self._bits) or (bool(self._last) and self._last[-1] == len(self._last) - 1)


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
        self._watch, self._gate = application.watch, application.gate
        self._naps = NapRounds(self._gate, self._watch, nap_s)
        self._sleepers: frozenset[int] = frozenset()
        self._begun_s = self._granted_s = 0.0
        self._asleep, self._seen_s, self._slept_s = False, 0.0, 0.0
        self._served = -1
        self._begun_runs: dict[int, bytes] = {}
        # Who ran since ``begin`` only because it was its time.
        self._in_vain: set[int] = set()
        self._noted = self._ticked = self._unlinked = self._fired = False
        self._usual_ns: dict[int, float] = {}
        # Who has to poll, what was counted of it when it slept last, and when it was seen to poll; None while somebody
        # else is awake. Of one that has not slept since it was to poll nothing is noted: it may have looked before.
        self._due: dict[int, tuple[Runs | None, float]] | None = None
        self._orders: dict[int, PollOrders] = {}
        self._usual = _USUAL
        self._lapses: dict[int, _Lapse] = {}
        self._wakes: dict[int, _Wake] = {}
        self._counted: tuple[float, dict[int, Runs]] = (0.0, {})
        self._known: frozenset[int] = frozenset()
        self._noted_s = self._looked_s = self._idle_s = 0.0
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
        self._begun_s, self._granted_s, self._begun_runs = now_s, 0.0, self._watch.runs
        self._seen_s, self._slept_s = now_s, 0.0
        self._watch.looker_waited_s()
        self._due, self.rest_s, self._ticked, self._usual = None, 0.0, ticked, _USUAL
        self._unlinked, self._fired = False, not ticked
        self._in_vain.clear()
        self._gate.hold = True
        self._naps.begin()

    def look(self, now_s: float) -> IdleState:
        """Returns whether the application is quiet; requests must have been served since the look before."""
        state, waited_s = self._look(now_s), self._watch.looker_waited_s()
        if self._asleep:  # a nap that is held lasts until whoever looks has a core
            self._slept_s += min(max(now_s - self._seen_s - waited_s, 0.0), _LONGEST_SEEN_S)
        self._seen_s = now_s
        return state

    def _look(self, now_s: float) -> IdleState:
        self._noted = False
        self._part_with_held(now_s)
        if self._due and not self._polled(now_s):
            return IdleState.WAITS
        self._looked_s = now_s
        self.application.find()
        rest, served = self._watch.look(self.pollers.keys()), self.graph.served
        heard, self._served = served != self._served, served
        self._noted = rest is not Rest.AWAKE
        self._asleep = self._noted and not heard  # who waited for an answer of the master's waited for whoever looks
        if self._lapses:
            self._take_back(now_s)
        awake = rest is Rest.AWAKE or bool(self.graph.busy)
        woken = self._watch.changed - self.pollers.keys() if rest is not Rest.AWAKE else frozenset[int]()
        anew = self._ran_anew(woken, now_s) | ({0} if heard else set[int]())
        if rest is not Rest.AWAKE:
            self._noted_s = now_s
        if awake or anew:
            self._begin_anew(anew, now_s)
            if not self.has_time(self._nap_s, now_s):
                self._gate.end_births()
                self._begin_to_poll(woken | self._watch.sleepers(), now_s)
            return IdleState.AWAKE if awake else IdleState.SOON
        self.rest_s = self.rest_s or now_s
        if not self._timers_fired(now_s):
            return IdleState.WAITS
        if self._end_nap(now_s):
            return IdleState.SOON
        if not self._proved(now_s) or not self._linked(now_s):
            return IdleState.WAITS
        return self._rested(rest, now_s)

    def _part_with_held(self, now_s: float) -> None:
        """Takes no thread for a poller whose nap is held: it polls when it is let go, and not by itself."""
        for tid in self.pollers.keys() & self._gate.held.keys():
            self._give_up(tid, now_s)
            self._naps.polling.add(tid)
            self._due = None

    def _ran_anew(self, woken: Set[int], now_s: float) -> set[int]:
        """Returns the processes in which polls have to change nothing once more, as some threads were run."""
        unasked = {tid for tid in woken if not self._in_time(tid, now_s)}
        self._in_vain = (self._in_vain | woken) - unasked
        self._naps.note_runs(unasked)
        anew = {self._watch.process(tid) for tid in unasked}
        if anew:  # what they sent may have come to a poller that waits for it, in another process
            anew |= {self._watch.process(tid) for tid in self.pollers if self._watch.listens(tid)}
        return anew

    def _timers_fired(self, now_s: float) -> bool:
        """Returns whether timers had their turn at a new time, before naps do: they run by themselves."""
        if not self._fired:
            napping = {self._watch.process(tid) for tid in self._gate.held}
            timing = {self._watch.process(tid) for tid in self.timers & self.pollers.keys()}
            self._fired = not napping & timing or self._proved(now_s)
        return self._fired

    def _end_nap(self, now_s: float) -> bool:
        """Returns whether a nap ended now that was held: only when all look in vain do the others have to poll."""
        if not self._gate.held and not self._naps.last:
            return False
        besides = self.pollers.keys() | self._in_vain
        self._naps.touch(self._watch.touched(self._begun_runs, besides) - self._naps.touched)
        known = len(self._naps.polling)
        if not self._naps.end_next(patient=self.has_time(self._nap_s, now_s)):
            return False
        if len(self._naps.polling) > known:
            self._granted_s = self._own_s()
        self._due = None
        return True

    def _linked(self, now_s: float) -> bool:
        """Returns whether nobody has still to connect: what was registered is waited for as a callback that naps."""
        if not self._begun_s or self.graph.linked():
            return True
        if not self._unlinked:  # what came before is no time that connecting took
            self._unlinked, self._granted_s = True, self._own_s()
        if self.has_time(self._nap_s, now_s):
            self.next_s = now_s + _ASK_S
            return False
        self.graph.give_links_up()
        return True

    def _rested(self, rest: Rest, now_s: float) -> IdleState:
        """Returns whether nobody sleeps who has not noticed what was sent, or naps within a callback."""
        waited_s, self.next_s = now_s - self._begun_s, now_s + _AGAIN_S
        if waited_s < _UNNOTICED_S and not self._watch.moved(self.pollers.keys()):
            return IdleState.WAITS
        napping = self._watch.napping(self._sleepers | self.pollers.keys() | self._gate.held.keys())
        if napping is None:
            return IdleState.SOON
        if napping and self.has_time(self._nap_s, now_s):
            return IdleState.WAITS
        if napping and self._begin_to_poll(napping, now_s):
            return IdleState.SOON
        self._sleepers |= napping
        return IdleState.STOPPED if rest is Rest.STOPPED else IdleState.QUIET

    def has_time(self, limit_s: float, now_s: float) -> bool:
        """Returns whether the application took less than a limit since the last ``begin``.

        What counts is its own doing: for how long a thread of it ran at most, and for how long all were seen to sleep;
        not what they waited for a core. Nor does what it took to find that threads have begun to poll.
        """
        took_s = now_s - self._begun_s
        if took_s < limit_s:
            return True
        return took_s < _LONGEST_LIMIT * limit_s and self._own_s() - self._granted_s < limit_s

    def _own_s(self) -> float:
        return self._slept_s + self._watch.ran_s(self._begun_runs)

    def restless(self, now_s: float) -> str:
        """Returns which threads were run most since the last ``begin``, whose, where and how often, for a person."""
        self._watch.snapshot()
        took_s, counts = now_s - self._begun_s, self._watch.counts_since_mark()
        awake = self._watch.awake()
        most = sorted(counts, key=lambda tid: (tid == awake, counts[tid]), reverse=True)[:_TOLD]
        told = [self._told(tid, counts[tid] / took_s) for tid in most if counts[tid] or tid == awake]
        return "; ".join(
            [each for each in told if each] + ["a node has not answered the robot yet"] * bool(self.graph.busy)
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
        self._counted = (now_s, self._watch.counted())

    def find_pollers(self, now_s: float) -> None:
        """Notes which threads ran again and again since ``count``, and which sleep by the wall's clock for longer."""
        begun_s, before = self._counted
        self._watch.snapshot()
        for tid, counted in self._watch.counted().items():
            runs = counted.times - before.get(tid, counted).times
            if runs < _POLLS or (now_s - begun_s) / runs >= _POLL_S:
                continue
            # What comes to a node at its start wakes threads that wait at sockets: only many runs are no chance.
            if runs >= _POLLS * _POLLS or not self._watch.listens(tid, _LOOKS):
                self._add_poller(tid, (now_s - begun_s) / runs, (counted.ran_ns - before[tid].ran_ns) / runs)
        self._known, self.suspect = frozenset(self._watch.runs), False

    def sleeps_on(self) -> bool:
        """Returns whether a thread has slept by the wall's clock ever since ``count``; ``rospy.spin`` wakes again."""
        self._watch.snapshot()
        before, now = self._counted[1], self._watch.counted()
        return any(before.get(tid) == now.get(tid) for tid in self._watch.sleepers())

    def find_sleepers(self) -> None:
        """Notes which threads sleep by the wall's clock while nothing is to be done, as ``rospy.spin`` does."""
        self._sleepers = self._watch.resting()

    def _begin_to_poll(self, napping: frozenset[int], now_s: float) -> bool:
        """Returns whether some of those that nap for too long, or do not rest, poll: all wait for them from now on."""
        waited_s, counts, before = now_s - self._begun_s, self._watch.counted(), self._begun_runs
        found: dict[int, Runs] = {}
        for tid in (napping - self.pollers.keys() - self._gate.held.keys() - {self._naps.last}) & counts.keys():
            begun = Runs.of(before.get(tid, b""))
            found[tid] = Runs(counts[tid].ran_ns - begun.ran_ns, 0, counts[tid].times - begun.times)
        found = {tid: ran for tid, ran in found.items() if ran.times >= _POLLS and waited_s / ran.times < _POLL_S}
        # What computes for long and hands it on from thread to thread does not poll, nor who is woken by what comes.
        found = {
            tid: ran
            for tid, ran in found.items()
            if self._watch.naps(tid) or (ran.ran_ns < _LITTLE_NS * ran.times and not self._watch.listens(tid))
        }
        for tid, ran in found.items():
            self._add_poller(tid, waited_s / ran.times, ran.ran_ns / ran.times)
            self._due, self._granted_s = None, self._own_s()
        return bool(found)

    def _add_poller(self, tid: int, period_s: float, usual_ns: float) -> None:
        self.pollers[tid], self._usual_ns[tid] = period_s, usual_ns
        if keeps_timers(self._watch.process(tid), tid):
            self.timers.add(tid)

    def _note_rest(self, now_s: float) -> None:
        """Notes which threads were run since the last look, when the application was taken for quiet."""
        if self._idle_s > _REST_KEPT_S:
            self._idle_s = 0.0
            self._idle_runs.clear()
        self._idle_s += now_s - self._looked_s
        woken = self._watch.changed - self.pollers.keys()
        self._idle_runs.update(woken)
        for tid in woken:
            self._in_time(tid, now_s)
        self._noted_s = now_s
        self._wakes = {tid: wake for tid, wake in self._wakes.items() if tid in self._watch.runs}
        often = any(runs >= _POLLS and self._idle_s / runs < _POLL_S for runs in self._idle_runs.values())
        self.suspect = self.suspect or often or not self._watch.runs.keys() <= self._known

    def _proved(self, now_s: float) -> bool:
        """Returns whether polling changes nothing any more; all who do not poll slept since the look before."""
        if self._due is None:
            self._orders = {}
            self._due = self._begin_orders(self._watch.touched(self._begun_runs, self.pollers.keys()), now_s)
            return not self._due
        # What is on its way between two sockets at this look is there at the next.
        confirmed, self._due, self.next_s = not self._due, {}, now_s
        return confirmed

    def _begin_anew(self, pids: Set[int], now_s: float) -> None:
        """Waits for all pollers of some processes again: somebody was run there. 0 stands for all processes."""
        if 0 in pids:
            self._naps.touch(pids)
            self._due = None
        elif self._due is not None and pids:
            self._due |= self._begin_orders(pids, now_s)

    def _begin_orders(self, pids: Set[int], now_s: float) -> dict[int, tuple[Runs | None, float]]:
        """Returns who has to poll: all pollers of those processes, in which anybody else was run."""
        groups: dict[int, list[int]] = {}
        for tid in self.pollers:
            pid = self._watch.process(tid)
            if pids & {pid, 0} and (self._ticked or tid not in self.timers):
                groups.setdefault(pid, []).append(tid)
        self._orders |= {pid: PollOrders(tids) for pid, tids in groups.items()}
        due = {tid: (self._asleep_runs(tid), now_s) for tids in groups.values() for tid in tids}
        self.next_s = now_s + _PEEK * min((self.pollers[tid] for tid in due), default=0.0)
        return due

    def _polled(self, now_s: float) -> bool:
        """Returns whether those who have to poll did so in every order; asks no others, so it costs little."""
        due, polled = self._due or {}, set[int]()
        counted = {tid: runs for tid in due if (runs := self._asleep_runs(tid)) is not None}
        self._asleep = len(counted) == len(due)
        for tid, now in counted.items():
            noted, at_s = due[tid]
            if noted is None:
                due[tid] = (now, now_s)
                continue
            runs = now.times - noted.times
            if runs > 0 and (now.ran_ns - noted.ran_ns) / runs > self._usual * self._usual_ns[tid] + _USUAL_NS:
                self._usual *= _USUAL
                self._due = None
                self._naps.touch({self._watch.process(tid)})
                return True
            if runs > 0:
                polled.add(tid)
            elif self._missed(tid, now_s - at_s, now_s):
                self._give_up(tid, now_s)
                self._due = None
                return True
        if polled:  # Who polls meanwhile began before these had polled: only its next time counts.
            self._due = {
                tid: (self._asleep_runs(tid), now_s if tid in polled else at_s) for tid, (_, at_s) in due.items()
            }
        for orders in self._orders.values():
            orders.add(polled)
        self.next_s = now_s + _PEEK * min(self.pollers[tid] for tid in due)
        return all(orders.all_seen for orders in self._orders.values())

    def _asleep_runs(self, tid: int) -> Runs | None:
        """Returns what is counted of a thread that sleeps: whatever it is run from now on, it looks after this.

        One that is awake may have lost its core within a look, and is run once more for that same look: None.
        """
        runs = Runs.of(self._watch.now(tid))
        return None if self._watch.waits_for_core(tid) else runs

    def _missed(self, tid: int, waited_s: float, now_s: float) -> bool:
        """Returns whether a thread does not poll any more, as it seems; one that sleeps until a time is waited for.

        A core that the machine's owner gives to others wakes nobody, and whoever sleeps on it looks late.
        """
        if waited_s < max(_MISSED_S, _MISSED_POLLS * self.pollers[tid]):
            return False
        return not (self._watch.sleeps_until(tid) and self.has_time(self._nap_s, now_s))

    def _in_time(self, tid: int, now_s: float) -> bool:
        """Returns whether a thread only woke up as it does again and again, each tenth of a second or more seldom.

        roscpp has three threads or more of that kind in each node: if one of them in a graph of ten nodes began
        everything anew, no round would end. It ran once, no longer than usual, and at its time as far as looks tell:
        who looks seldom, because others have the cores, knows only after and before which look.
        """
        counted = Runs.of(self._watch.runs.get(tid, b""))
        before = self._wakes.get(tid) or _Wake(now_s, now_s, counted)
        ran_ns, waited_s = counted.ran_ns - before.counted.ran_ns, (counted.waited_ns - before.counted.waited_ns) / 1e9
        once, usual_s = counted.times - before.counted.times == 1, before.period_s
        least_s, most_s = self._noted_s - before.at_s - waited_s, now_s - before.after_s - waited_s
        gap_s, off_s = (most_s + least_s) / 2, (most_s - least_s) / 2
        wake = before._replace(after_s=self._noted_s, at_s=now_s, counted=counted, gap_s=0.0)
        if once and _POLL_S < gap_s < _SELDOM_S and ran_ns < _LITTLE_NS and off_s < _LOOKED * gap_s:
            wake = wake._replace(gap_s=gap_s)
            if abs(gap_s - before.gap_s) < _IN_TIME * gap_s + off_s:
                wake = wake._replace(period_s=gap_s, usual_ns=ran_ns)
        self._wakes[tid] = wake
        usual = once and usual_s > 0.0 and ran_ns < min(_LITTLE_NS, _USUAL * before.usual_ns + _USUAL_NS)
        return usual and least_s < (1.0 + _IN_TIME) * usual_s and most_s > (1.0 - _IN_TIME) * usual_s

    def _give_up(self, tid: int, now_s: float) -> None:
        """Waits no more for a thread that does not poll any more, as it seems."""
        before, runs = self._lapses.get(tid), Runs.of(self._watch.now(tid)).times
        polls = min(2 * before.polls, _MOST_POLLS) if before is not None else _POLLS
        period_s = self.pollers.pop(tid)
        if not self._watch.listens(tid):  # what comes to a socket wakes whoever waits for it, and no one has to wait
            self._lapses[tid] = _Lapse(period_s, now_s, runs, polls)

    def _take_back(self, now_s: float) -> None:
        """Waits again for threads that were given up, and have polled since: nobody rests whom one of them wakes."""
        counts = self._watch.counted()
        for tid in self._lapses.keys() - self.pollers.keys():
            lapse = self._lapses[tid]
            runs, at_gate = counts.get(tid, Runs()).times - lapse.runs, tid in self._gate.held or tid == self._naps.last
            if runs < lapse.polls and not at_gate:
                continue
            if not at_gate and (now_s - lapse.at_s) / runs < _POLL_S:
                self._add_poller(tid, lapse.period_s, self._usual_ns[tid])
                self._due = None
            else:  # it slept for long, or was let go: what it does from now on says whether it polls
                self._lapses[tid] = lapse._replace(at_s=now_s, runs=counts.get(tid, Runs()).times)


def _shown(rate_hz: float) -> str:
    """Returns a rate with two digits, as a number without an exponent."""
    return f"{float(f'{rate_hz:.2g}'):g}"
