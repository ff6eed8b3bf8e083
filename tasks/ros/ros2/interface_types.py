"""ROS 2's interface types: their definitions, their names on DDS, their hashes.

Sources: ROS 2's design article "Topic and Service name mapping to DDS"; REP 2011 (evolving message types) for hashes;
rmw_cyclonedds and rmw_dds_common for what readers and writers say in USER_DATA.
"""

import functools
from typing import cast

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

DEFAULT_DISTRIBUTION = "jazzy"
_STORES = {
    "humble": Stores.ROS2_HUMBLE,
    "iron": Stores.ROS2_IRON,
    "jazzy": Stores.ROS2_JAZZY,
    "kilted": Stores.ROS2_KILTED,
}
DISTRIBUTIONS = tuple(_STORES)
_WITHOUT_HASHES = ("humble",)
_ROBOMAKER = "robomaker_simulation_msgs"
TAG, ADD_TAGS, CANCEL = f"{_ROBOMAKER}/msg/Tag", f"{_ROBOMAKER}/srv/AddTags", f"{_ROBOMAKER}/srv/Cancel"
ADD_TAGS_SERVICE, CANCEL_SERVICE = "/robomaker/job/add_tags", "/robomaker/job/cancel"
_TEXT: FieldDesc = (Nodetype.BASE, ("string", 0))
_ANSWER: list[tuple[str, FieldDesc]] = [("success", (Nodetype.BASE, ("bool", 0))), ("message", _TEXT)]


@functools.cache
def type_store(distribution: str = DEFAULT_DISTRIBUTION) -> Typestore:
    """Returns the definitions of a distribution's types, RoboMaker's services among them."""
    store = get_typestore(_STORES[distribution])
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
        }
    )
    return store


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


def topic_name(topic: str) -> str:
    """Returns a topic's name on DDS: ``rt/scan`` for ``/scan``."""
    return f"rt{topic}"


def request_name(service: str) -> str:
    """Returns the DDS topic of a service's requests."""
    return f"rq{service}Request"


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
