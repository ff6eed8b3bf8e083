"""A replay is what was recorded, to the last bit; and says so, and why, where it is not."""

import io
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console
from typer.testing import CliRunner

from flows.batch import replay_episode
from flows.batch.replay_episode import JobReplay, Wanted, replay_job, wanted_files, write_files
from flows.cli.replay_commands import replay_answer, show_replay
from flows.cli.shell import app
from simyard.answer.batch_answers import Replay
from specs.data.result_columns import REQUESTED
from specs.errors import DocumentError, ResourceNotFound
from specs.pipeline.simulation_section import Recordings
from tasks.housekeeping.object_kinds import kind_of_key
from tasks.results.playback import replay_formats
from tasks.results.tables.result_files import recorded_samples, stored_rows
from tasks.simulate.batch.batch_record import KIND, OpenBatch
from tasks.simulate.data import mounts
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import output_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tests.factories.bag_messages import read_bag
from tests.factories.batches import closed_batch, pushing_plan
from tests.factories.planned_batches import begun
from tests.factories.simulations import pen


@pytest.fixture(scope="module")
def batch(tmp_path_factory: pytest.TempPathFactory) -> OpenBatch:
    """A batch of 32 episodes in two chunks, all recorded, in Parquet and as bags."""
    store = open_store((tmp_path_factory.mktemp("replay") / "store").as_uri())
    recordings = Recordings(episodes="all", rateHz=4, bags=("rosbag", "rosbag2"))
    return closed_batch(store, pushing_plan(store, recordings=recordings))


@pytest.fixture(scope="module")
def again(batch: OpenBatch) -> JobReplay:
    return replay_job(batch.store, f"{batch.id}/4")


@pytest.mark.long
def test_twenty_random_episodes_deviate_by_nothing(batch: OpenBatch):
    drawn = np.random.default_rng(7).choice(batch.layout.episodes, 20, replace=False)
    for index in drawn.tolist():
        found = replay_job(batch.store, f"{batch.id}/{index}")
        assert found.same, replay_answer(found)
        assert {each.most for each in found.deviations} == {0.0}


def test_the_row_its_way_and_its_recording_are_compared(again: JobReplay):
    columns = {each.column for each in again.deviations}
    assert {"simulated_s", "final_x_m", "energy_j", "goal_times_s", "outcome_reason", "environment"} <= columns
    assert {"trajectory_x_m", "failure_reason", "recording.ranges_m", "recording.impulse_ns"} <= columns


def test_a_job_is_named_by_its_arn_too(batch: OpenBatch, again: JobReplay):
    assert replay_job(batch.store, f"arn:simyard:simulation-job:0:{batch.id}/4").deviations == again.deviations


def test_the_answer_is_zero_in_every_column(again: JobReplay):
    columns = len(again.deviations)
    assert replay_answer(again) == [
        f"{again.job}: collision; deviation 0 in all {columns} columns, {len(REQUESTED)} of its request not shown"
    ]


def test_tables_as_they_were_written_are_no_cause(again: JobReplay):
    assert not [cause for cause in again.causes if "SHA-256" in cause]


def test_columns_that_are_not_shown_are_those_left_out_of_the_table(again: JobReplay):
    out = io.StringIO()
    show_replay(again, Console(file=out, width=200))
    lines = out.getvalue().splitlines()
    assert len(lines) == 1 + len(again.deviations) - len(REQUESTED) + 1  # a heading, the columns, the answer


def test_extras_are_named_in_the_help():
    told = CliRunner().invoke(app, ["replay", "--help"]).output
    assert [f"simyard[{extra}]" in told for extra in ("mcap", "video", "ros")] == [True] * 3


Tamper = Callable[[str, str, object], None]


@pytest.fixture
def tampered(batch: OpenBatch) -> Iterator[Tamper]:
    """Returns a function that changes what was recorded of episode 4: (table, column, value)."""
    location = recorded_location(batch.record())
    bucket = open_bucket(batch.store, location.s3Bucket or "")
    before: dict[str, bytes] = {}

    def change(name: str, column: str, value: object) -> None:
        key = output_key(location.s3Prefix, f"{batch.id}/{name}")
        before[key] = bucket.get(key).body
        table = pq.read_table(pa.BufferReader(before[key]))
        values = [
            value if index == 4 else old
            for index, old in zip(table.column("index").to_pylist(), table.column(column).to_pylist(), strict=True)
        ]
        field = table.schema.field(column)
        sink = pa.BufferOutputStream()
        pq.write_table(table.set_column(table.column_names.index(column), field, pa.array(values, field.type)), sink)
        bucket.put(key, sink.getvalue().to_pybytes())

    yield change
    for key, body in before.items():
        bucket.put(key, body)


def test_a_number_that_is_off_in_its_last_bit_is_found(batch: OpenBatch, tampered: Tamper):
    location = recorded_location(batch.record())
    x_m = stored_rows(batch.store, location, batch.id, "failures.parquet", index=4).column("final_x_m")[0].as_py()
    tampered("failures.parquet", "final_x_m", float(np.nextafter(x_m, 9.0)))
    found = replay_job(batch.store, f"{batch.id}/4")
    (deviation,) = [each for each in found.deviations if not each.same]
    assert deviation.column == "final_x_m"
    assert 0.0 < deviation.most < 1e-12
    assert replay_answer(found)[1].startswith("may be why: ")
    assert "/failures.parquet is not what the batch wrote: its SHA-256 is " in replay_answer(found)[1]


def test_a_word_that_differs_is_told_with_what_may_be_why(
    batch: OpenBatch, tampered: Tamper, monkeypatch: pytest.MonkeyPatch
):
    tampered("failures.parquet", "outcome_reason", "stuck")

    def elsewhere(lanes: int) -> Mapping[str, str]:
        return {"lanes": str(lanes), "jax": "9.9"}

    monkeypatch.setattr(replay_episode, "batch_metadata", elsewhere)
    monkeypatch.setattr(replay_episode, "this_machine", lambda: "abacus")
    told = replay_answer(replay_job(batch.store, f"{batch.id}/4"))
    assert told[0].endswith("columns deviate: outcome_reason differs")
    assert "failures.parquet is not what the batch wrote" in told[1]
    assert told[2].startswith("may be why: jax was ")
    assert told[2].endswith(", and is 9.9")
    assert told[3].startswith("may be why: it ran on ")
    assert told[3].endswith(", and this is abacus")


def test_a_job_without_an_end_is_refused(file_store: Store):
    batch = begun(file_store)
    with pytest.raises(DocumentError, match="a job of a batch that has its tables; this one is InProgress"):
        replay_job(file_store, f"{batch.id}/0")


def test_a_job_that_was_cancelled_has_nothing_to_compare(batch: OpenBatch, tampered: Tamper):
    tampered("results.parquet", "success", None)
    with pytest.raises(DocumentError, match="this one was canceled"):
        replay_job(batch.store, f"{batch.id}/4")


def test_a_world_that_has_changed_is_refused(batch: OpenBatch):
    key = world_key("hand", "pen-1")
    before = batch.store.get(key).body
    batch.store.put(key, pen(4.5, 9).model_dump_json().encode())
    mounts._world.cache_clear()
    with pytest.raises(ResourceNotFound, match="world hand/pen-1 is not what it was"):
        replay_job(batch.store, f"{batch.id}/31")
    batch.store.put(key, before)


def test_an_arn_of_something_else_is_refused(batch: OpenBatch):
    with pytest.raises(DocumentError, match="a simulation-job, such as"):
        replay_job(batch.store, f"arn:simyard:{KIND}:0:{batch.id}")


def test_the_command_ends_with_0_for_the_same_bits_and_with_1_for_others(
    batch: OpenBatch, tampered: Tamper, tmp_path: Path
):
    command = ["replay", f"{batch.id}/4", "--store", batch.store.url, "--no-mcap", "--output", str(tmp_path)]
    sound = CliRunner().invoke(app, command)
    assert (sound.exit_code, "deviation 0 in all" in sound.output) == (0, True)
    tampered("failures.parquet", "simulated_s", 1.0)
    wrong = CliRunner().invoke(app, command)
    assert (wrong.exit_code, "columns deviate: simulated_s" in wrong.output) == (1, True)
    assert (tmp_path / "replay.svg").is_file()


def test_drawing_and_mcap_are_written(again: JobReplay, tmp_path: Path):
    files = write_files(again, tmp_path / "new" / "folder", Wanted(mcap=True, video=False))
    assert [path.name for path in files] == ["replay.svg", "replay.mcap"]
    assert all(path.stat().st_size > 1000 for path in files)


def test_a_replay_in_python_writes_the_same_files(again: JobReplay, tmp_path: Path):
    files = Replay(again).save(tmp_path, mcap=False, bags=["mcap-ros1"])
    assert [path.name for path in files] == ["replay.svg", "replay-ros1.mcap"]


@pytest.mark.long
def test_without_a_gl_the_film_is_from_above(again: JobReplay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    assert again.playback
    *_, film = write_files(again, tmp_path, Wanted(mcap=False, video=True))
    with av.open(str(film)) as opened:
        assert opened.streams.video[0].frames == len(again.playback.t_s)


def test_what_is_not_installed_is_left_out_or_refused_with_the_remedy(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(replay_formats, "find_spec", lambda _: None)
    assert wanted_files(mcap=None, video=False) == Wanted(mcap=False, video=False)
    with pytest.raises(DocumentError, match=r"--mcap: .*pip install 'simyard\[mcap\]'"):
        wanted_files(mcap=True, video=False)
    with pytest.raises(DocumentError, match=r"--video: .*pip install 'simyard\[video\]'"):
        wanted_files(mcap=None, video=True)
    with pytest.raises(DocumentError, match=r"--bag: rosbag: .*pip install 'simyard\[ros\]'"):
        wanted_files(mcap=None, video=False, bags=["rosbag"])


def test_a_bag_of_no_format_is_refused_with_those_that_there_are():
    with pytest.raises(DocumentError, match="--bag: 'ros3': one of rosbag, mcap-ros1, rosbag2"):
        wanted_files(mcap=False, video=False, bags=["ros3"])


def test_a_replays_bag_has_each_step_and_the_twists_of_the_controls(again: JobReplay, tmp_path: Path):
    *_, bag = write_files(again, tmp_path, Wanted(mcap=False, video=False, bags=("rosbag",)))
    played = again.playback
    assert (bag.name, played is not None) == ("replay.bag", True)
    assert played
    scans, twists = (read_bag(bag, topic) for topic in ("/scan", "/cmd_vel"))
    assert np.array_equal([scan.ranges for scan in scans], seen(played.ranges_m[played.acted], played.sight.range_m))
    assert [twist.linear.x for twist in twists] == pytest.approx(played.control[played.acted, 0].tolist())
    assert len(read_bag(bag, "/clock")) == len(played.t_s)


def test_a_batchs_bags_are_its_recordings_to_the_last_bit(batch: OpenBatch, again: JobReplay, tmp_path: Path):
    assert again.playback
    location = recorded_location(batch.record())
    bucket = open_bucket(batch.store, location.s3Bucket or "")
    for index in (4, 21):
        (name,) = stored_rows(batch.store, location, batch.id, "results.parquet", index=index).column("recording")
        rows = recorded_samples(batch.store, location, batch.id, str(name), index).to_pydict()
        folder = output_key(location.s3Prefix, f"bags/{batch.id}")
        bucket.download(f"{folder}/{index:06d}.bag", tmp_path / f"{index}.bag")
        poses = [message.pose.pose.position for message in read_bag(tmp_path / f"{index}.bag", "/ground_truth/odom")]
        assert [(at.x, at.y) for at in poses] == list(zip(rows["x_m"], rows["y_m"], strict=True))
        scans = [message.ranges for message in read_bag(tmp_path / f"{index}.bag", "/scan")]
        acted = np.array([ranges for ranges in rows["ranges_m"] if ranges], np.float32)
        assert np.array_equal(scans, seen(acted, again.playback.sight.range_m))
        controls = [message.data.tolist() for message in read_bag(tmp_path / f"{index}.bag", "/simyard/control")]
        assert controls == [control for control in rows["control"] if control]


def test_a_batchs_record_says_where_its_bags_are(batch: OpenBatch):
    url = str(batch.record().detail["bags_url"])
    assert url.endswith(f"/bags/{batch.id}")
    keys = batch.store.keys(url.removeprefix(f"{batch.store.url}/"))
    assert len([key for key in keys if key.endswith(".bag")]) == batch.layout.episodes
    assert len([key for key in keys if key.endswith("-rosbag2/metadata.yaml")]) == batch.layout.episodes
    assert {kind_of_key(key).what for key in keys} == {"bags"}


def seen(ranges_m: np.ndarray, range_m: float) -> np.ndarray:
    """Returns ranges as ROS has them: infinite where nothing is near enough."""
    return np.where(ranges_m >= np.float32(range_m), np.inf, ranges_m)
