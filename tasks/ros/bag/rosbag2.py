"""Writes a log as a folder of rosbag2: a file in MCAP, and ``metadata.yaml`` as Humble writes it (version 5).

Later releases read earlier versions of the metadata; the earliest that is still supported reads this one.
"""

from pathlib import Path

from tasks.ros.bag.message_log import MessageLog
from tasks.ros.bag.message_types import long_name
from tasks.ros.bag.ros_mcap import WrittenMcap, offered_qos, plain_yaml, write_ros_mcap

METADATA_FILE = "metadata.yaml"
_VERSION = 5


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
