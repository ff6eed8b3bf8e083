"""A service of ROS 2 over Cyclone DDS: requests and replies are topics, their samples begin with whose they are.

Source: rmw_cyclonedds, ``cdds_request_header_t`` and ``rmw_init_cs``; other middlewares mark requests in another way.
"""

import secrets
from collections.abc import Callable

from tasks.ros.ros2.dds_node import DdsNode
from tasks.ros.ros2.interface_types import reply_name, request_name
from tasks.ros.ros2.qos_profiles import SERVICES

_ENCAPSULATION_BYTES = 4
# The client's identity, 8 bytes, and the number of its request, 8 bytes.
_HEADER_BYTES = 16
_IDENTITY_BYTES = 16


class ServiceServer:
    """Answers requests.

    Args:
        node: Whose service it is.
        service: Its name, such as ``/robomaker/job/cancel``.
        kind: Its type, such as ``robomaker_simulation_msgs/srv/Cancel``.
        answer: From a request's CDR to its reply's, each with an encapsulation header.
    """

    def __init__(self, node: DdsNode, service: str, kind: str, answer: Callable[[bytes], bytes]) -> None:
        identity = ".".join(f"{each:x}" for each in secrets.token_bytes(_IDENTITY_BYTES))
        own, self._answer = f"serviceid={identity};", answer
        self._requests = node.reader(request_name(service), f"{kind}_Request", SERVICES, own, service=True)
        self._replies = node.writer(reply_name(service), f"{kind}_Response", SERVICES, own, service=True)

    def serve(self) -> int:
        """Answers what has come; returns how many requests that were."""
        requests = self._requests.take()
        for each in requests:
            begin, end = _ENCAPSULATION_BYTES, _ENCAPSULATION_BYTES + _HEADER_BYTES
            # The header's 16 bytes leave the alignment of what follows as it is.
            reply = self._answer(each[:begin] + each[end:])
            self._replies.write(reply[:begin] + each[begin:end] + reply[begin:])
        return len(requests)
