"""The robot's services over TCPROS: RoboMaker's tags of a job, and its end.

RoboMaker serves these names and types in every simulation (github.com/aws-robotics/aws-robomaker-simulation-ros-pkgs,
package robomaker_simulation_msgs).
"""

import struct
from collections.abc import Callable, Mapping

from tasks.ros.graph.publication import ROBOT
from tasks.ros.graph.wire.channel import Channel
from tasks.ros.graph.wire.connection_header import write_header
from tasks.ros.message.definition import ANY, digest
from tasks.ros.message.service_message import (
    REQUEST_BYTES,
    joined_tags,
    read_keys,
    read_tags,
    write_outcome,
    write_tags,
)
from tasks.ros.message.stamp import frame_message

_LENGTH = struct.Struct("<I")
SERVICES: Mapping[str, str] = {
    "/robomaker/job/add_tags": "robomaker_simulation_msgs/AddTags",
    "/robomaker/job/cancel": "robomaker_simulation_msgs/Cancel",
    "/robomaker/job/list_tags": "robomaker_simulation_msgs/ListTags",
    "/robomaker/job/remove_tags": "robomaker_simulation_msgs/RemoveTags",
}
"""Types by name."""


class RobotServices:
    """Answers requests to the robot's services.

    Attributes:
        tags: What the application gave.
        cancelled: Whether it asked for the end of its job.
    """

    def __init__(self) -> None:
        self.tags: dict[str, str] = {}
        self.cancelled = False
        self._functions: dict[str, Callable[[bytes], bytes]] = {
            "/robomaker/job/add_tags": self._add_tags,
            "/robomaker/job/cancel": self._cancel,
            "/robomaker/job/list_tags": self._list_tags,
            "/robomaker/job/remove_tags": self._remove_tags,
        }

    def connect(self, channel: Channel, fields: Mapping[str, str]) -> None:
        """Answers a client's header, and its requests from now on."""
        service = fields.get("service", "")
        kind = SERVICES.get(service)
        if kind is None:
            fault = f"the robot has no service {service[:200]!r}"
        elif fields.get("md5sum") not in (ANY, digest(kind)):
            fault = f"{service} is {kind} with md5sum {digest(kind)}, not {fields.get('md5sum', '')[:40]!r}"
        else:
            fault = ""
        if kind is None or fault:
            channel.send(write_header({"error": fault}))
            channel.finish()
            return
        answer = {
            "callerid": ROBOT,
            "md5sum": digest(kind),
            "request_type": f"{kind}Request",
            "response_type": f"{kind}Response",
            "type": kind,
        }
        channel.send(write_header(answer))
        if fields.get("probe") == "1":
            channel.finish()
            return
        kept = fields.get("persistent", "0").lower() in ("1", "true")
        channel.use(lambda: self._take(channel, service, kept=kept), lambda: None)
        self._take(channel, service, kept=kept)

    def _take(self, channel: Channel, service: str, *, kept: bool) -> None:
        incoming = channel.incoming
        while not channel.closed and len(incoming) >= 4:
            (length,) = _LENGTH.unpack_from(incoming)
            if length > REQUEST_BYTES:
                fault = f"{service}: a request of {length} bytes, {REQUEST_BYTES} are taken"
                channel.send(b"\0" + frame_message(fault.encode()))
                channel.finish()
                return
            if len(incoming) < 4 + length:
                return
            request = bytes(incoming[4 : 4 + length])
            del incoming[: 4 + length]
            channel.send(self._answer(service, request))
            if not kept:
                channel.finish()
                return

    def _answer(self, service: str, request: bytes) -> bytes:
        """Returns the response after a 1, or a text after a 0 if the request cannot be read."""
        try:
            return b"\1" + frame_message(self._functions[service](request))
        except ValueError as exc:
            return b"\0" + frame_message(f"{service}: {exc}".encode())

    def _add_tags(self, request: bytes) -> bytes:
        given = read_tags(request)
        try:
            self.tags = joined_tags(self.tags, given)
        except ValueError as exc:
            return write_outcome(success=False, message=str(exc))
        return write_outcome(success=True, message="")

    def _remove_tags(self, request: bytes) -> bytes:
        for key in read_keys(request):
            self.tags.pop(key, None)
        return write_outcome(success=True, message="")

    def _list_tags(self, _: bytes) -> bytes:
        return write_outcome(success=True, message="") + write_tags(self.tags)

    def _cancel(self, _: bytes) -> bytes:
        self.cancelled = True
        return write_outcome(success=True, message="")
