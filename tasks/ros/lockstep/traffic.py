"""A lock-step that keeps what a lane's robot told its nodes, and what they commanded: for a bag of an episode.

It stands before any other lock-step, of ROS 1 or ROS 2, and writes each message once more, since what is written
follows from what is sensed. What nodes tell each other goes past it.
"""

from collections.abc import Mapping, Sequence

from tasks.ros.bag.message_log import FIRST_NS, Channel, Entry, MessageLog
from tasks.ros.lockstep.exchange import Base, Command, FloorPlan, Lockstep, Sensed, Tally
from tasks.ros.lockstep.sensor_message import CLOCK, Moment, SensorMessages
from tasks.ros.message.motion_message import PlanarTwist, twist


class Traffic:
    """The applications of all lanes, with a log of one lane; see ``Lockstep``.

    Args:
        lockstep: Has the applications.
        base: The robot's base.
        control_s: Simulated time of a control step.
        lane: Which is kept.
    """

    def __init__(self, lockstep: Lockstep, base: Base, control_s: float, lane: int = 0) -> None:
        self._inner, self._lane = lockstep, lane
        self._messages = SensorMessages(base, control_s)
        self._control_ns = round(control_s * 1e9)
        self._entries: list[Entry] = []
        self._goal: tuple[float, float] | None = None
        self._step = 0

    @property
    def failures(self) -> Mapping[int, str]:
        """Returns why applications failed, by lane."""
        return self._inner.failures

    @property
    def cancelled(self) -> frozenset[int]:
        """Returns the lanes whose application called ``/robomaker/job/cancel``."""
        return self._inner.cancelled

    def begin(self, sensed: Sequence[Sensed | None], floors: Sequence[FloorPlan | None]) -> None:
        """Waits until every application is ready, and lets it warm up; of that nothing is kept."""
        self._inner.begin(sensed, floors)
        own = sensed[self._lane]
        if own is not None:
            fixed = self._messages.fixed(Moment(0, FIRST_NS, own), floors[self._lane])
            self._entries += [Entry(FIRST_NS, topic, data) for topic, data in fixed.items()]

    def exchange(self, sensed: Sequence[Sensed | None]) -> list[Command]:
        """Returns each lane's command for the control step to come, having kept what one lane's robot said."""
        own, before = sensed[self._lane], self._inner.tally(self._lane).commands
        if own is not None:
            self._keep_sensed(Moment(self._step, FIRST_NS + self._step * self._control_ns, own))
        commands = self._inner.exchange(sensed)
        if own is not None and self._inner.tally(self._lane).commands > before:
            at_ns, command = FIRST_NS + self._step * self._control_ns, commands[self._lane]
            self._entries.append(Entry(at_ns, self._messages.commands.name, twist(PlanarTwist(*command))))
        self._step += 1
        return commands

    def tally(self, lane: int) -> Tally:
        """Returns how the exchange of a lane went so far."""
        return self._inner.tally(lane)

    def tags(self, lane: int) -> Mapping[str, str]:
        """Returns what a lane's application gave to ``/robomaker/job/add_tags``."""
        return self._inner.tags(lane)

    def close(self) -> None:
        """Ends every process; the log stays."""
        self._inner.close()

    def log(self) -> MessageLog:
        """Returns what was kept, in times since the episode began; in a control step the last command."""
        topics = (*self._messages.topics, self._messages.commands)
        # The clock is latched for nodes that come late; in a bag it is a topic like others.
        channels = tuple(Channel(each.name, each.kind, latched=each.latched and each.name != CLOCK) for each in topics)
        return MessageLog(channels, tuple(self._entries))

    def _keep_sensed(self, moment: Moment) -> None:
        for topic in self._messages.order:
            self._entries.append(Entry(moment.time_ns, topic, self._messages.write(topic, moment)))
        x_m, y_m = map(float, moment.sensed.goal)
        found = self._messages.goal(moment) if self._goal != (x_m, y_m) else None
        if found is not None:
            self._goal = (x_m, y_m)
            self._entries.append(Entry(moment.time_ns, *found))
