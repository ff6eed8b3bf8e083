"""Writes a log in the formats that are asked for."""

from collections.abc import Collection
from pathlib import Path

from specs.data.bag_format import BAG_ENDINGS, BagFormat
from tasks.ros.bag.message_log import MessageLog
from tasks.ros.bag.ros_mcap import write_ros_mcap
from tasks.ros.bag.rosbag import write_rosbag
from tasks.ros.bag.rosbag2 import write_rosbag2


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
