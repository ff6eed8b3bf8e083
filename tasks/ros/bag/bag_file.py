"""A log of messages as a file: a rosbag of ROS 1, a bag of ROS 2, or MCAP with ROS messages.

The same log gives the same bytes: neither the machine nor its clock is in the file. Later releases of ROS 2 read
earlier versions of a bag's metadata; the earliest release that is still supported reads this one.
"""

import functools
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Literal, NamedTuple, cast

import lz4.frame
import yaml
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as RosbagWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from specs.field_types import BAG_ENDINGS, BagFormat
from tasks.ros.bag.message_log import SENDER, Channel, Encoding, MessageLog

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


Profile = Literal["ros1", "ros2"]
_LIBRARY = "simyard"
# Qualities of service by the numbers of rmw/types.h: rosbag2 knows words for them only since Jazzy.
_KEEP_LAST, _RELIABLE, _TRANSIENT_LOCAL, _VOLATILE, _AUTOMATIC = 1, 1, 1, 2, 1
_FOR_EVER = {"sec": 9_223_372_036, "nsec": 854_775_807}
_QUEUE = 10


class WrittenMcap(NamedTuple):
    """What a file holds.

    Attributes:
        counts: How many messages of each topic.
        first_ns, last_ns: Times of the first and of the last message; 0 if there is none.
    """

    counts: Mapping[str, int]
    first_ns: int
    last_ns: int


def write_ros_mcap(path: Path, log: MessageLog, profile: Profile) -> WrittenMcap:
    """Writes a log as MCAP, and returns what the file holds.

    Args:
        path: The file, overwritten.
        log: What it holds.
        profile: Whose messages: those of ROS 1, or those of ROS 2.
    """
    encoding: Encoding = "ros1" if profile == "ros1" else "cdr"
    recode = transcoder(ros2_types(log.channels), log.encoding, encoding)
    kinds = {channel.topic: channel.kind for channel in log.channels}
    counts, first_ns, last_ns = dict.fromkeys(kinds, 0), 0, 0
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.ZSTD)
        writer.start(profile=profile, library=_LIBRARY)
        channels = _ros1_channels(writer, log) if profile == "ros1" else _ros2_channels(writer, log)
        for number, (time_ns, topic, body) in enumerate(log.entries):
            recoded = recode(body, kinds[topic])
            writer.add_message(channels[topic], time_ns, recoded, time_ns, sequence=number)
            counts[topic] += 1
            first_ns, last_ns = first_ns or time_ns, time_ns
        writer.finish()
    return WrittenMcap(counts, first_ns, last_ns)


def offered_qos(channel: Channel) -> str:
    """Returns the quality of service that a channel's publisher offers, as rosbag2 keeps it: a text in YAML."""
    qos = {
        "history": _KEEP_LAST,
        "depth": 1 if channel.latched else _QUEUE,
        "reliability": _RELIABLE,
        "durability": _TRANSIENT_LOCAL if channel.latched else _VOLATILE,
        "deadline": _FOR_EVER,
        "lifespan": _FOR_EVER,
        "liveliness": _AUTOMATIC,
        "liveliness_lease_duration": _FOR_EVER,
        "avoid_ros_namespace_conventions": False,
    }
    return plain_yaml([qos]).strip()


def plain_yaml(document: object) -> str:
    """Returns a document as YAML in which each value is written out wherever it stands."""
    return yaml.dump(document, Dumper=_Plain, sort_keys=False)


class _Plain(yaml.SafeDumper):
    """Writes values out wherever they stand, since not every reader follows YAML's anchors."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002 - PyYAML asks so
        return True


def _ros1_channels(writer: McapWriter, log: MessageLog) -> dict[str, int]:
    types, schemas = ros1_types(log.channels), dict[str, int]()
    channels: dict[str, int] = {}
    for channel in log.channels:
        text, md5sum = channel.definition, channel.md5sum
        if not text or not md5sum:
            text, md5sum = types.generate_msgdef(long_name(channel.kind))
        if channel.kind not in schemas:
            schemas[channel.kind] = writer.register_schema(channel.kind, "ros1msg", text.encode())
        about = {"callerid": SENDER, "md5sum": md5sum, "topic": channel.topic, "latching": str(int(channel.latched))}
        channels[channel.topic] = writer.register_channel(channel.topic, "ros1", schemas[channel.kind], about)
    return channels


def _ros2_channels(writer: McapWriter, log: MessageLog) -> dict[str, int]:
    types, schemas = ros2_types(log.channels), dict[str, int]()
    channels: dict[str, int] = {}
    for channel in log.channels:
        name = long_name(channel.kind)
        if name not in schemas:
            text, _ = types.generate_msgdef(name, ros_version=2)
            schemas[name] = writer.register_schema(name, "ros2msg", text.encode())
        about = {"offered_qos_profiles": offered_qos(channel)}
        channels[channel.topic] = writer.register_channel(channel.topic, "cdr", schemas[name], about)
    return channels


def write_rosbag(path: Path, log: MessageLog) -> None:
    """Writes a log as a bag.

    Args:
        path: The file, overwritten.
        log: What it holds.
    """
    path.unlink(missing_ok=True)
    types = ros1_types(log.channels)
    recode = transcoder(ros2_types(log.channels), log.encoding, "ros1")
    kinds = {channel.topic: channel.kind for channel in log.channels}
    bag = RosbagWriter(path)
    bag.compression_format, bag.compressor = "lz4", _frame
    with bag:

        def connect(channel: Channel) -> Connection:
            text, digest = channel.definition, channel.md5sum
            if not text or not digest:
                text, digest = types.generate_msgdef(long_name(channel.kind))
            return bag.add_connection(
                channel.topic,
                long_name(channel.kind),
                msgdef=text,
                md5sum=digest,
                callerid=SENDER,
                latching=int(channel.latched),
            )

        connections = {channel.topic: connect(channel) for channel in log.channels}
        for time_ns, topic, body in log.entries:
            bag.write(connections[topic], time_ns, recode(body, kinds[topic]))


def _frame(chunk: bytes) -> bytes:
    """Returns a chunk as ROS 1 compresses it.

    Its reader (roslz4, lz4s.c) refuses frames whose blocks build on one another, that have no checksum at their end or
    that say their size at the beginning, which are those that rosbags writes.
    """
    return cast("bytes", lz4.frame.compress(chunk, block_linked=False, content_checksum=True, store_size=False))


METADATA_FILE = "metadata.yaml"
_VERSION = 5


# Later releases read earlier versions of the metadata; the earliest that is still supported reads this one.
def write_rosbag2(folder: Path, log: MessageLog) -> list[Path]:
    """Writes a log as a folder of rosbag2, and returns the files in it.

    Args:
        folder: Made if it is not there; files in it are overwritten. Its name is that of the file inside, too.
        log: What it holds.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{folder.name}_0.mcap", folder / METADATA_FILE]
    written = write_ros_mcap(files[0], log, "ros2")
    files[1].write_text(_metadata(files[0].name, log, written), encoding="utf-8")
    return files


def _metadata(name: str, log: MessageLog, written: WrittenMcap) -> str:
    count = sum(written.counts.values())
    span = {
        "duration": {"nanoseconds": written.last_ns - written.first_ns},
        "starting_time": {"nanoseconds_since_epoch": written.first_ns},
        "message_count": count,
    }
    topics = [
        {
            "topic_metadata": {
                "name": channel.topic,
                "type": long_name(channel.kind),
                "serialization_format": "cdr",
                "offered_qos_profiles": offered_qos(channel),
            },
            "message_count": written.counts[channel.topic],
        }
        for channel in log.channels
    ]
    about = {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [name],
        "files": [{"path": name, **span}],
    }
    return plain_yaml({"rosbag2_bagfile_information": about})


def write_bags(folder: Path, name: str, log: MessageLog, formats: Collection[BagFormat]) -> list[Path]:
    """Returns the files of a log, written over what is there.

    Args:
        folder: Where; it exists.
        name: What they are called, without the ending.
        log: What they hold.
        formats: The formats.
    """
    # Messages may be made while they are read, and each format reads them all.
    whole = log._replace(entries=tuple(log.entries)) if len(formats) > 1 else log
    return [path for asked in formats for path in _write_bag(folder, name, whole, asked)]


def _write_bag(folder: Path, name: str, log: MessageLog, asked: BagFormat) -> list[Path]:
    path = folder / f"{name}{BAG_ENDINGS[asked]}"
    match asked:
        case "rosbag":
            write_rosbag(path, log)
        case "mcap-ros1":
            write_ros_mcap(path, log, "ros1")
        case "rosbag2":
            return write_rosbag2(path, log)
    return [path]
