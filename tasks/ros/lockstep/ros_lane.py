"""One episode in lock-step: its graph, its application, what is still to be sent to it, and what came of it."""

import asyncio
import contextlib
import contextvars
import heapq
import logging
import math
import select
import selectors
import socket
from collections import deque
from collections.abc import Callable
from typing import TypeVarTuple, Unpack

from tasks.ros.lockstep.exchange import ExchangeTotals, TopicListener, TwistCommand
from tasks.ros.lockstep.idle_detector import IdleDetector
from tasks.ros.lockstep.robot_topics import CLOCK
from tasks.ros.message.ros_messages import frame_message, read_twist
from tasks.ros.process.network import EpisodeNetwork

_LOG = logging.getLogger(__name__)
_TURNS = 1000
Ts = TypeVarTuple("Ts")


class _TimedLoop(asyncio.SelectorEventLoop):
    """An event loop that knows when it has something to do although nothing comes: an answer that is held, a limit."""

    def __init__(self, selector: selectors.BaseSelector) -> None:
        self._times_s: list[float] = []
        super().__init__(selector)

    def call_at(
        self,
        when: float,
        callback: Callable[[Unpack[Ts]], object],
        *args: *Ts,
        context: contextvars.Context | None = None,
    ) -> asyncio.TimerHandle:
        """Calls a function when the loop runs at this time or later."""
        heapq.heappush(self._times_s, when)
        return super().call_at(when, callback, *args, context=context)

    def due(self) -> bool:
        """Returns whether the time of a call has come since this was asked last."""
        found = False
        while self._times_s and self._times_s[0] <= self.time():
            heapq.heappop(self._times_s)
            found = True
        return found


class EventPump:
    """An event loop that runs only when it is asked to, so that nothing happens behind the back of whoever asks.

    Attributes:
        loop: Serves the graphs.
    """

    def __init__(self) -> None:
        # Both descriptors are made before any lane has its own: select() takes none above 1023, and it alone naps for
        # less than a millisecond.
        selector = selectors.EpollSelector()
        self.loop = _TimedLoop(selector)
        self._requests = selector.fileno()
        self._commands = select.epoll()

    def watch(self, sock: socket.socket) -> None:
        """Lets naps end when a command comes."""
        with contextlib.suppress(FileExistsError):
            self._commands.register(sock, select.EPOLLIN)

    def serve(self) -> None:
        """Answers all requests that have come or are due, and those that come meanwhile."""
        if self.loop.due():
            self.turn()
        for _ in range(_TURNS):
            if not select.select([self._requests], [], [], 0.0)[0]:
                return
            self.turn()

    def turn(self) -> None:
        """Runs the loop once: what has come, and what is due."""
        self.loop.call_soon(self.loop.stop)
        self.loop.run_forever()

    def nap(self, seconds: float) -> bool:
        """Waits until a request or a command comes, or the time is over; returns whether a command came."""
        return self._commands in select.select([self._requests, self._commands], [], [], max(seconds, 0.0))[0]

    def close(self) -> None:
        """Closes the loop."""
        self._commands.close()
        self.loop.close()


# A node that sends more in one control step does not answer what it senses.
_COMMANDS_A_STEP = 1000
# One that goes by the wall's clock is not in lock-step: some such commands are counted, many are no episode.
_STRAY_COMMANDS = 200
# The first look comes a little before the end that is to be expected, and never late because others took the cores.
_REMEMBERED = 0.5
_SHARE = 0.6
_LONGEST_GUESS_S = 0.0015
_LAST_WORDS_S = 3.0

Writer = Callable[[], bytes]


class RosLane:
    """One episode.

    Args:
        detector: Says when its application is quiet.
        network: Its own.
        pump: Serves its graph.
        latched: Topics whose last message is kept for those who come.
        contended: Returns whether two processes told a third one something since the last call.

    Attributes:
        graph: Its own.
        application: Its processes.
        failure: Why it cannot go on, for a person; empty while it can.
        command: The last one that came.
        commanded_ns: Simulated time when it came.
        topic: What it was sent last.
        goal: The goal that its nodes know.
        asked_ns: Simulated time when they were told it.
        commands, late, stray: See ``ExchangeTotals``.
        unordered: Messages within which two processes told a third one something, and datagrams that were dropped.
        begun_s: When it was sent something last.
        look_s: When to look at it next.
        nap_s: How long to wait after a look that found it awake.
    """

    def __init__(
        self,
        detector: IdleDetector,
        network: EpisodeNetwork,
        pump: EventPump,
        latched: frozenset[str],
        contended: Callable[[], bool] = bool,
    ) -> None:
        self.detector, self.network = detector, network
        self.graph, self.application = detector.graph, detector.application
        self.failure, self.command, self.commanded_ns = "", TwistCommand(), -math.inf
        self.goal: tuple[float, float] | None = None
        self.asked_ns = 0
        self.commands = self.late = self.stray = self.unordered = 0
        self.begun_s = self.look_s = self.nap_s = 0.0
        self._pump, self._latched, self._contended = pump, latched, contended
        self._changes, self._had_source, self._sources = -1, False, 0
        self._topics: deque[tuple[str, Writer]] = deque()
        self._frame, self._to = b"", deque[TopicListener]()
        self.topic = ""
        self._usual_s: dict[str, float] = {}
        self._step_commands = 0

    def plan(self, topics: list[tuple[str, Writer]]) -> None:
        """Notes what is to be sent in a control step, in this order."""
        self._topics, self._to = deque(topics), deque()
        self._step_commands = 0

    def send(self, now_s: float, *, fresh: bool) -> bool:
        """Sends the next message to one node; returns False if all has been sent.

        A node at a time and a topic at a time: what nodes send each other then has one order.

        Args:
            now_s: By a clock that only grows.
            fresh: Whether the lane was looked at a moment ago.
        """
        while not self._to:
            if not self._topics:
                return False
            self.topic, write = self._topics.popleft()
            subscribers, latched = self.graph.outgoing[self.topic], self.topic in self._latched
            if subscribers or latched:
                data = write()
                self._frame = frame_message(data)
                if latched:
                    self.graph.keep(self.topic, data)
                self._to = deque(sorted(subscribers, key=lambda each: each.node))
        self.detector.begin(now_s, fresh=fresh, ticked=self.topic == CLOCK)
        self._to.popleft().connection.send(self._frame)
        self.begun_s, self.nap_s = now_s, 0.0
        self.look_s = now_s + min(_SHARE * self._usual_s.get(self.topic, 0.0), _LONGEST_GUESS_S)
        return True

    def note_rest(self) -> None:
        """Notes how long the application took to deal with what was sent last, and whether that had one order."""
        if self._contended():
            self.unordered += 1
            if self.unordered == 1:
                _LOG.warning("after %s was sent, two processes told a third one something: in no order", self.topic)
        took_s = self.detector.rest_s - self.begun_s
        usual_s = self._usual_s.get(self.topic, took_s)
        self._usual_s[self.topic] = _REMEMBERED * usual_s + (1.0 - _REMEMBERED) * took_s

    def collect(self, time_ns: int, *, stray: bool = False) -> None:
        """Takes the commands that have come.

        Args:
            time_ns: Simulated time.
            stray: Whether the lane was taken for quiet before they came.
        """
        if self.failure:
            return
        if self.graph.changes != self._changes:
            self._changes = self.graph.changes
            for source in self.graph.incoming:
                self._had_source = True
                self._pump.watch(source.sock)
            came, self._sources = len(self.graph.incoming) > self._sources, len(self.graph.incoming)
            if stray and came:
                self.stray += 1
                _LOG.warning("a node began to command the robot while nothing was sent to it")
        for topic, data in self.graph.take():
            try:
                twist = read_twist(data)
            except ValueError as exc:
                self.failure = f"{topic}: {exc}"
                return
            if not all(map(math.isfinite, twist)):
                self.failure = f"{topic}: a command is not a number: {tuple(twist)}"
                return
            self.command, self.commanded_ns = TwistCommand(*twist), time_ns
            self.commands += 1
            self.stray += stray
            self._step_commands += 1
        if self._step_commands > _COMMANDS_A_STEP:
            self.failure = f"more than {_COMMANDS_A_STEP} commands came in one control step"
        if self.stray > _STRAY_COMMANDS:
            self.failure = f"{self.stray} commands came by the wall's clock, while nothing was sent to its nodes"

    def drain(self) -> None:
        """Throws away the commands that came before the episode begins."""
        self._step_commands = 0
        self.collect(0)
        self.command, self._step_commands = TwistCommand(), 0

    def notice_ends(self) -> None:
        """Notices which nodes ended, and fails if one should not have."""
        self.failure = self.failure or self.application.failure()
        self.graph.forget(self.application.ended)

    def check(self) -> None:
        """Looks whether a node ended, or the graph gave up."""
        self.application.await_leaving(self.graph.nodes(), _LAST_WORDS_S)
        self.notice_ends()
        self.failure = self.failure or self.graph.failure
        if self.application.tests_passed() is not None:
            return
        if not self.failure and self._had_source and not self.graph.incoming:
            # A node that ends unregisters first, and says a moment later with which status.
            self.failure = self.application.last_failure(_LAST_WORDS_S)
            done = [f"node {name} ended with status 0, and " for name in sorted(self.application.done)]
            self.failure = self.failure or "".join(done[-1:]) + "no node is connected to the command topic any more"

    def tally(self) -> ExchangeTotals:
        """Returns how the exchange went."""
        return ExchangeTotals(self.commands, self.late + self.unordered, self.stray, self.graph.navigation.recoveries)
