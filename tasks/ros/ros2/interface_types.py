"""ROS 2's interface types: their definitions, their names on DDS, their hashes.

Sources: ROS 2's design article "Topic and Service name mapping to DDS"; REP 2011 (evolving message types) for hashes;
rmw_cyclonedds and rmw_dds_common for what readers and writers say in USER_DATA; nav2_msgs,
``action/NavigateToPose.action``, of Nav2's branches humble, iron, jazzy and kilted; ROS 2's design article "Actions".
"""

import functools
from collections.abc import Mapping
from typing import cast

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Basename, FieldDesc, Typesdict
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tasks.ros.ros2.ros2_installation import DEFAULT_DISTRIBUTION

_WITHOUT_HASHES = ("humble",)
_ROBOMAKER = "robomaker_simulation_msgs"
TAG, ADD_TAGS, CANCEL = f"{_ROBOMAKER}/msg/Tag", f"{_ROBOMAKER}/srv/AddTags", f"{_ROBOMAKER}/srv/Cancel"
NAVIGATE = "nav2_msgs/action/NavigateToPose"
POSE, UUID = "geometry_msgs/msg/PoseStamped", "unique_identifier_msgs/msg/UUID"
_RANGE, _DURATION = "sensor_msgs/msg/Range", "builtin_interfaces/msg/Duration"
_TEXT: FieldDesc = (Nodetype.BASE, ("string", 0))
_ANSWER: list[tuple[str, FieldDesc]] = [("success", (Nodetype.BASE, ("bool", 0))), ("message", _TEXT)]


def _base(name: Basename) -> FieldDesc:
    return (Nodetype.BASE, (name, 0))


def _named(kind: str) -> FieldDesc:
    return (Nodetype.NAME, kind)


_CODE, _WORDS = ("error_code", _base("uint16")), ("error_msg", _TEXT)
_RESULTS: Mapping[str, list[tuple[str, FieldDesc]]] = {
    "humble": [("result", _named("std_msgs/msg/Empty"))],
    "iron": [_CODE],
}


def navigation_types(distribution: str) -> Typesdict:
    """Returns the definitions of the action's goal, result and feedback, and of its services, in a release of ROS 2."""
    goal_id = ("goal_id", _named(UUID))
    fields: Mapping[str, list[tuple[str, FieldDesc]]] = {
        "Goal": [("pose", _named(POSE)), ("behavior_tree", _TEXT)],
        "Result": _RESULTS.get(distribution, [_CODE, _WORDS]),
        "Feedback": [
            ("current_pose", _named(POSE)),
            ("navigation_time", _named(_DURATION)),
            ("estimated_time_remaining", _named(_DURATION)),
            ("number_of_recoveries", _base("int16")),
            ("distance_remaining", _base("float32")),
        ],
        "FeedbackMessage": [goal_id, ("feedback", _named(f"{NAVIGATE}_Feedback"))],
        "SendGoal_Request": [goal_id, ("goal", _named(f"{NAVIGATE}_Goal"))],
        "SendGoal_Response": [("accepted", _base("bool")), ("stamp", _named("builtin_interfaces/msg/Time"))],
        "GetResult_Request": [goal_id],
        "GetResult_Response": [("status", _base("int8")), ("result", _named(f"{NAVIGATE}_Result"))],
    }
    return {f"{NAVIGATE}_{name}": ([], each) for name, each in fields.items()}


@functools.cache
def type_store(distribution: str = DEFAULT_DISTRIBUTION) -> Typestore:
    """Returns the definitions of a distribution's types, RoboMaker's services among them."""
    store = get_typestore(Stores[f"ROS2_{distribution.upper()}"])
    # char of a .msg file is uint8 in the IDL that hashes are taken of; rosbags takes it for IDL's char.
    for kind, (constants, fields) in list(store.fielddefs.items()):
        store.fielddefs[kind] = (constants, [(name, _without_char(form)) for name, form in fields])
    tags: FieldDesc = (Nodetype.SEQUENCE, ((Nodetype.NAME, TAG), 0))
    store.register(
        {
            TAG: ([], [("key", _TEXT), ("value", _TEXT)]),
            f"{ADD_TAGS}_Request": ([], [("tags", tags)]),
            f"{ADD_TAGS}_Response": ([], _ANSWER),
            f"{CANCEL}_Request": ([], []),
            f"{CANCEL}_Response": ([], _ANSWER),
            **navigation_types(distribution),
        }
    )
    return store


def beyond_ros1(kind: str, distribution: str = DEFAULT_DISTRIBUTION) -> bytes:
    """Returns what a message of a release of ROS 2 has behind the fields that it has in ROS 1, with 0 for unknown."""
    has_variance = kind == _RANGE and type_store(distribution).fielddefs[kind][1][-1][0] == "variance"
    return bytes(4) if has_variance else b""


def _without_char(form: FieldDesc) -> FieldDesc:
    node, detail = form
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element, count = cast("tuple[FieldDesc, int]", detail)
        return cast("FieldDesc", (node, (_without_char(element), count)))
    return (Nodetype.BASE, ("uint8", 0)) if form == (Nodetype.BASE, ("char", 0)) else form


def dds_type_name(kind: str) -> str:
    """Returns a type's name on DDS: ``sensor_msgs::msg::dds_::LaserScan_`` for ``sensor_msgs/msg/LaserScan``."""
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def ros_type_name(dds_kind: str) -> str:
    """Returns a type's name on DDS as ROS 2 has it; the reverse of ``dds_type_name``."""
    return dds_kind.replace("::dds_::", "::").replace("::", "/").removesuffix("_")


def topic_name(topic: str) -> str:
    """Returns a topic's name on DDS: ``rt/scan`` for ``/scan``."""
    return f"rt{topic}"


def request_name(service: str) -> str:
    """Returns the DDS topic of a service's requests."""
    return f"rq{service}Request"


def is_service(dds_topic: str) -> bool:
    """Returns whether a DDS topic is one of a service's."""
    return dds_topic.startswith(("rq/", "rr/"))


def reply_name(service: str) -> str:
    """Returns the DDS topic of a service's replies."""
    return f"rr{service}Reply"


def type_hash(kind: str, distribution: str = DEFAULT_DISTRIBUTION) -> str:
    """Returns a type's hash, ``RIHS01_`` and 64 hexadecimal digits (REP 2011)."""
    return type_store(distribution).hash_rihs01(kind)


def user_data(kind: str, distribution: str = DEFAULT_DISTRIBUTION, own: str = "") -> bytes:
    """Returns what a reader or a writer says in USER_DATA: the hash of its type; Humble does not know it.

    Args:
        kind: The type.
        distribution: The release of ROS 2 that is spoken to.
        own: Pairs that come first, such as ``serviceid=...;``.
    """
    return f"{own}{'' if distribution in _WITHOUT_HASHES else f'typehash={type_hash(kind, distribution)};'}".encode()
