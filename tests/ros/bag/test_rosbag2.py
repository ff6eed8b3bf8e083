"""A folder of rosbag2 is read by another reader: its topics, counts, span and qualities of service."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability

from specs.field_types import BAG_ENDINGS
from tasks.ros.bag.bag_file import write_bags
from tests.ros.bag.tracks import SAMPLES, log, track


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("rosbag2")
    files = write_bags(place, "000007", log(), ["rosbag2"])
    assert [path.relative_to(place).as_posix() for path in files] == [
        "000007-rosbag2/000007-rosbag2_0.mcap",
        "000007-rosbag2/metadata.yaml",
    ]
    return files[0].parent


def test_its_metadata_say_what_is_in_it(folder: Path):
    with AnyReader([folder]) as reader:
        assert reader.message_count == len(list(log().entries))
        assert reader.start_time == 1_000_000_000
        assert reader.topics["/odom"].msgcount == SAMPLES


def test_whoever_listens_later_still_gets_the_map(folder: Path):
    with AnyReader([folder]) as reader:
        offered = {
            each.topic: each.ext.offered_qos_profiles[0].durability
            for each in reader.connections
            if isinstance(each.ext, ConnectionExtRosbag2)
        }
    assert offered["/map"] == offered["/tf_static"] == QosDurability.TRANSIENT_LOCAL
    assert offered["/scan"] == QosDurability.VOLATILE


def test_its_scans_are_those_of_the_log(folder: Path):
    with AnyReader([folder]) as reader:
        scans = [reader.deserialize(body, each.msgtype) for each, _, body in reader.messages() if each.topic == "/scan"]
    assert np.array_equal([getattr(scan, "ranges") for scan in scans], track().ranges_m[:-1])  # noqa: B009


def test_all_formats_are_written_of_one_log(tmp_path: Path):
    files = write_bags(tmp_path, "x", log(), list(BAG_ENDINGS))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x-ros1.mcap", "x-rosbag2", "x.bag"]
    assert all(path.stat().st_size for path in files)
