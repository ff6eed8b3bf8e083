"""The message types of a log: their definitions in ROS 1 and in ROS 2, and a message's bytes in the other one."""

import functools
from collections.abc import Callable, Iterable

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tasks.ros.bag.message_log import Channel, Encoding

# ROS brings it along, but rosbags does not know it in ROS 1.
_FRAMES = "geometry_msgs/TransformStamped[] transforms\n"


def long_name(kind: str) -> str:
    """Returns a type's name as ROS 2 writes it: ``sensor_msgs/msg/LaserScan``."""
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name.removeprefix('msg/')}"


def ros1_types(channels: Iterable[Channel] = ()) -> Typestore:
    """Returns the types of ROS 1 (Noetic), and those that the channels define themselves.

    Raises:
        TypesysError: A definition is none.
    """
    return _with_own(_noetic_types, channels)


def ros2_types(channels: Iterable[Channel] = ()) -> Typestore:
    """Returns the types of ROS 2 (Humble), and those that the channels define themselves.

    Raises:
        TypesysError: A definition is none.
    """
    return _with_own(_humble_types, channels)


def transcoder(store: Typestore, source: Encoding, target: Encoding) -> Callable[[bytes, str], bytes]:
    """Returns what turns the bytes of a message of a kind into those of another encoding.

    Args:
        store: The types as ROS 2 has them, whose headers count nothing.
        source: What the bytes are in.
        target: What is returned.
    """
    if source == target:
        return lambda body, _: body
    if target == "cdr":
        return lambda body, kind: bytes(store.ros1_to_cdr(body, long_name(kind)))
    return lambda body, kind: bytes(store.cdr_to_ros1(body, long_name(kind)))


def _noetic_types() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_FRAMES, "tf2_msgs/msg/TFMessage"))
    return store


def _humble_types() -> Typestore:
    return get_typestore(Stores.ROS2_HUMBLE)


@functools.cache
def _kept(make: Callable[[], Typestore]) -> Typestore:
    """Returns types that nobody adds to; to make them takes longer than to write the bag of a short episode."""
    return make()


def _with_own(make: Callable[[], Typestore], channels: Iterable[Channel]) -> Typestore:
    own = [channel for channel in channels if channel.definition]
    if not own:
        return _kept(make)
    store = make()
    for channel in own:
        found = get_types_from_msg(channel.definition, long_name(channel.kind))
        store.register({name: each for name, each in found.items() if name not in store.types})
    return store
