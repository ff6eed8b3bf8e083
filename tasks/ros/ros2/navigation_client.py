"""Nav2's action NavigateToPose, as the robot's node asks for it: a client on plain DDS.

Sources: ROS 2's design article "Actions", with the numbers of the ends of goals.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from tasks.ros.message.navigation import GoalStatus, Navigation
from tasks.ros.ros2.dds_node import (
    DEFAULT,
    ENCAPSULATION_BYTES,
    HEADER_BYTES,
    NO_MESSAGE,
    SERVICES,
    DdsNode,
    Reader,
    Writer,
)
from tasks.ros.ros2.interface_types import NAVIGATE, POSE, UUID, reply_name, request_name

ACTION = "/navigate_to_pose"
_SEND, _RESULT = f"{ACTION}/_action/send_goal", f"{ACTION}/_action/get_result"
_FEEDBACK = f"{NAVIGATE}_FeedbackMessage"
_ID_BYTES = 16
# Whose requests these are: 8 bytes of a client's identity, which no other one draws.
_CLIENT = b"simyard\0"

_ENDS: Mapping[int, GoalStatus] = {4: "succeeded", 5: "canceled", 6: "aborted"}


class NavigationClient:
    """Sends goals to whoever offers the action in one process, and asks for their results.

    Args:
        node: The robot's node that this process sees.
        store: Has the types.
        navigation: What is written to.
        headers: Whether requests have rmw_cyclonedds's header. Fast DDS marks them beside the message, which cannot be
            read here: there each answer that comes is taken for the robot's own.
    """

    def __init__(self, node: DdsNode, store: Typestore, navigation: Navigation, *, headers: bool) -> None:
        self._store, self._navigation, self._headers = store, navigation, headers
        self._goals, self._answers = _service(node, _SEND, "SendGoal", headers=headers)
        self._asks, self._results = _service(node, _RESULT, "GetResult", headers=headers)
        self._feedback = node.subscription(f"{ACTION}/_action/feedback", _FEEDBACK, DEFAULT)

    @property
    def ready(self) -> bool:
        """Returns whether a node of the process offers the action."""
        asks, answers = (self._goals, self._asks), (self._answers, self._results, self._feedback)
        return all(each.readers for each in asks) and all(each.writers for each in answers)

    def acknowledged(self) -> bool:
        """Returns whether what was asked has come."""
        return self._goals.acknowledged() and self._asks.acknowledged()

    def send(self, pose: bytes) -> None:
        """Sends a goal, given as a ``geometry_msgs/PoseStamped`` in ROS 1's form."""
        self._navigation.begin()
        kind = f"{NAVIGATE}_Goal"
        stamped: Any = self._store.deserialize_cdr(bytes(self._store.ros1_to_cdr(pose, POSE)), POSE)
        goal = self._store.types[kind](pose=stamped, behavior_tree="")
        self._write(self._goals, "SendGoal", goal_id=self._goal_id(), goal=goal)

    def serve(self) -> int:
        """Takes what was answered, and feedback; returns how much was answered."""
        answers, results = self._answers.take(), self._results.take()
        try:
            for each in self._feedback.take():
                self._note_feedback(self._store.deserialize_cdr(each, _FEEDBACK))
            for each in filter(None, map(self._own, answers)):
                self._note_answer(self._read(each, "SendGoal"))
            for each in filter(None, map(self._own, results)):
                self._note_result(self._read(each, "GetResult"))
        except NO_MESSAGE as exc:
            self._navigation.fault = f"{ACTION}: an answer that is none: {exc}"
        return len(answers) + len(results)

    def _note_feedback(self, said: Any) -> None:  # noqa: ANN401 - a class that rosbags makes
        if bytes(said.goal_id.uuid) == self._goal_number():
            self._navigation.recovered(int(said.feedback.number_of_recoveries))

    def _note_answer(self, answer: Any) -> None:  # noqa: ANN401 - a class that rosbags makes
        if self._navigation.status != "asked":
            return
        self._navigation.status = "accepted" if answer.accepted else "rejected"
        if answer.accepted:
            self._write(self._asks, "GetResult", goal_id=self._goal_id())

    def _note_result(self, answer: Any) -> None:  # noqa: ANN401 - a class that rosbags makes
        own = self._navigation
        if own.status == "accepted":
            own.status = _ENDS.get(int(answer.status), "aborted")
            own.error_code = int(getattr(answer.result, "error_code", 0))

    def _goal_id(self) -> Any:  # noqa: ANN401 - a class that rosbags makes
        """Returns the goal's number as its identity: the same in each repeat."""
        return self._store.types[UUID](uuid=np.frombuffer(self._goal_number(), np.uint8))

    def _goal_number(self) -> bytes:
        return self._navigation.goals.to_bytes(_ID_BYTES)

    def _write(self, writer: Writer, service: str, **fields: Any) -> None:  # noqa: ANN401 - what rosbags takes
        kind = f"{NAVIGATE}_{service}_Request"
        cdr = bytes(self._store.serialize_cdr(self._store.types[kind](**fields), kind))
        header = self._header() if self._headers else b""
        writer.write(cdr[:ENCAPSULATION_BYTES] + header + cdr[ENCAPSULATION_BYTES:])

    def _header(self) -> bytes:
        return _CLIENT + self._navigation.goals.to_bytes(HEADER_BYTES - len(_CLIENT), "little")

    def _own(self, cdr: bytes) -> bytes:
        """Returns an answer without its header; nothing for one to somebody else."""
        if not self._headers:
            return cdr
        begin, end = ENCAPSULATION_BYTES, ENCAPSULATION_BYTES + HEADER_BYTES
        return cdr[:begin] + cdr[end:] if cdr[begin:end] == self._header() else b""

    def _read(self, cdr: bytes, service: str) -> Any:  # noqa: ANN401 - a class that rosbags makes
        return self._store.deserialize_cdr(cdr, f"{NAVIGATE}_{service}_Response")


def _service(node: DdsNode, name: str, kind: str, *, headers: bool) -> tuple[Writer, Reader]:
    """Returns what asks a service of the action, and what hears its answers."""
    asks = node.writer(request_name(name), f"{NAVIGATE}_{kind}_Request", SERVICES, service=headers)
    return asks, node.reader(reply_name(name), f"{NAVIGATE}_{kind}_Response", SERVICES, service=headers)
