"""Bags lie beside recordings: of the episodes that are recorded, in the formats that are asked for, none of others."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from flows.batch.batch_end import RecordedEpisodes, bags_url, bags_written
from specs.errors import DocumentError
from specs.field_types import BagFormat, OutputLocation
from specs.pipeline.simulation_section import Recordings
from tasks.results.playback import replay_formats
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.lane.recording import Columns
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.factories.planned_batches import begun, plan, template
from tests.factories.simulations import REPOSITORY, ROBOT

WHERE = OutputLocation(s3Bucket="results", s3Prefix="nightly")
FOLDERS = {ROBOT.digest: REPOSITORY / "applications/courier"}


def samples(*indices: int) -> Columns:
    """Returns three samples of each of some episodes, as a recorder gives them."""
    rows = 3 * len(indices)
    still = np.zeros((rows, 3), np.float32)
    return {
        "index": np.repeat(np.array(indices), 3),
        "t_s": np.tile([0.0, 0.1, 0.2], len(indices)),
        "pose": still,
        "velocity": still,
        "goal_index": np.zeros(rows, np.int32),
        "acted": np.tile([True, True, False], len(indices)),
        "control": still,
        "ranges_m": np.ones((rows, 4), np.float32),
        "impulse_ns": np.zeros(rows, np.float32),
        "goal_m": np.ones((rows, 2)),
        "lidar": np.tile([0.1, 0.0, 0.0, 0.2, 6.0, -0.5, 0.25], (rows, 1)),
    }


def recording(store: Store, bags: Iterable[BagFormat] | None, **changes: object) -> OpenBatch:
    asked = Recordings(episodes="all", bags=None if bags is None else tuple(bags))
    return begun(store, plan(store, recordings=asked, **changes))


def written(batch: OpenBatch) -> list[str]:
    return open_bucket(batch.store, "results").keys(f"nightly/bags/{batch.id}")


def test_each_recorded_episode_has_its_files_beside_its_recording(file_store: Store):
    batch = recording(file_store, ["rosbag", "mcap-ros1", "rosbag2"])
    assert RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0, 1), samples(3)]) == "000000.parquet"
    folder = f"nightly/bags/{batch.id}"
    assert written(batch) == sorted(
        f"{folder}/{name}"
        for index in ("000000", "000001", "000003")
        for name in (
            f"{index}-ros1.mcap",
            f"{index}-rosbag2/{index}-rosbag2_0.mcap",
            f"{index}-rosbag2/metadata.yaml",
            f"{index}.bag",
        )
    )
    assert bags_url(batch, WHERE).endswith(f"results/{folder}")


def test_the_bag_of_who_is_cancelled_while_it_is_written_goes(file_store: Store):
    batch = recording(file_store, ["rosbag"])
    episodes = RecordedEpisodes(batch, WHERE, FOLDERS)
    episodes.write(0, [samples(0, 1)])
    episodes.write(0, [samples(1)])
    assert [Path(key).name for key in written(batch)] == ["000001.bag"]


def test_the_same_samples_are_the_same_bytes_on_any_attempt(file_store: Store):
    batch = recording(file_store, ["rosbag", "rosbag2"])
    bucket = open_bucket(batch.store, "results")
    RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0)])
    before = {key: bucket.get(key).body for key in written(batch)}
    RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0)])
    assert {key: bucket.get(key).body for key in written(batch)} == before


def test_a_request_that_records_all_topics_gets_a_rosbag_as_robomaker_wrote_one(file_store: Store):
    old = (template(record=True), template())
    batch = recording(file_store, None, templates=old)
    both = [batch.layout.request(index).index for index in range(batch.layout.episodes)]
    first = [index for index in both if batch.layout.template_of(index) == 0]
    RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(*both[:4], *both[-2:])])
    names = {int(Path(key).stem) for key in written(batch)}
    assert names == {*both[:4], *both[-2:]} & set(first)
    assert names


def test_an_empty_list_means_no_bags_whatever_a_request_says(file_store: Store):
    batch = recording(file_store, [], templates=(template(record=True),))
    RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0)])
    assert written(batch) == []
    assert not bags_written(batch)


def test_an_old_request_does_not_fail_for_want_of_an_extra(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(replay_formats, "find_spec", lambda _: None)
    batch = recording(file_store, None, templates=(template(record=True),))
    assert RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0)]) == "000000.parquet"
    assert written(batch) == []


def test_bags_that_a_document_asks_for_are_refused_without_what_writes_them(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(replay_formats, "find_spec", lambda _: None)
    with pytest.raises(DocumentError, match=r"simulationBatch.recordings.bags: rosbag: .*simyard\[ros\]"):
        RecordedEpisodes(recording(file_store, ["rosbag"]), WHERE, FOLDERS).write(0, [samples(0)])
