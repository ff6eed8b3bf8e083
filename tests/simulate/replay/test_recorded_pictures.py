"""Recordings with pictures: what is kept is what the robot saw, the same bytes each time, and nothing strange."""

import io
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from PIL import Image

from flows.batch.replay_episode import replay_job
from specs.data.people import People
from specs.pipeline.simulation_section import Recordings
from tasks.results.tables.result_files import recorded_samples
from tasks.ros.message.camera_messages import depth_png, depths_in_mm
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.simulate.replay import recorded_pictures
from tasks.simulate.sandbox.protocol import Answer, Crashed, Pictures
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tests.factories.bag_messages import read_bag
from tests.factories.batches import PENS, PUSHER, closed_batch, pushing_plan
from tests.servers.tools import skip_or_fail

SEER = """
import numpy as np

jax = False


class Depth:
    columns, rows, fov_rad, range_m, z_m, rate_hz, sigma_m_per_m2, dropout = 12, 8, 1.2, 3.0, 0.3, 10.0, 0.01, 0.1


class Eye:
    columns, rows, rate_hz, noise = 12, 6, 5.0, 0.05


class Seer:
    depth_camera, color_camera = Depth(), Eye()

    def reset(self, floor, goals_m):
        pass

    def step(self, observation):
        return np.array([0.3, 0.1, 0.2], np.float32)


def controller(environment):
    return Seer()
"""


def seeing_batch(folder: Path, *, robot: str = SEER, people: People | None = None) -> OpenBatch:
    """Returns a batch of a robot with both cameras, whose recordings and bags keep two pictures a second."""
    bundle = shutil.copytree(PUSHER, folder / "seer")
    (bundle / "faulty" / "pushing.py").write_text(robot)
    store = open_store((folder / "store").as_uri())
    recordings = Recordings(episodes="all", rateHz=4, picturesHz=2, bags=("rosbag", "rosbag2"))
    worlds = {"hand/pen-0": PENS["hand/pen-0"]}
    plan = pushing_plan(store, robot=bundle, worlds=worlds, seeds=(3, 4), recordings=recordings, people=people)
    return closed_batch(store, plan)


def recording(batch: OpenBatch, index: int) -> pa.Table:
    location = recorded_location(batch.record())
    return recorded_samples(batch.store, location, batch.id, "000000.parquet", index)


@pytest.mark.long
@pytest.mark.parametrize("people", [None, People(count=2)], ids=["nobody", "people"])
def test_a_recording_keeps_what_the_robot_saw_and_a_replay_finds_the_same_bytes(tmp_path: Path, people: People | None):
    batch = seeing_batch(tmp_path, people=people)
    again = replay_job(batch.store, f"{batch.id}/1")
    if "InternalServiceError" in {each.recorded for each in again.deviations if each.column == "failure_code"}:
        skip_or_fail("no GL draws")
    assert {"recording.depth_png", "recording.color_jpeg"} <= {each.column for each in again.deviations}
    assert again.same
    table, film = recording(batch, 1), again.playback and again.playback.depth
    assert film
    rows = zip(table.column("t_s").to_pylist(), table.column("depth_png").to_pylist(), strict=True)
    kept = {t_s: png for t_s, png in rows if png}
    assert 2 <= len(kept) <= 2 * max(kept) + 2
    known = dict(zip(film.t_s.round(6).tolist(), film.pictures, strict=True))
    both = [t_s for t_s in kept if t_s in known]
    assert len(both) >= 2
    for t_s in both:
        found = np.asarray(Image.open(io.BytesIO(kept[t_s])))
        np.testing.assert_array_equal(found, depths_in_mm(known[t_s], 3.0))
    assert len({kept[t_s] for t_s in both}) == len(both)
    jpegs = [each for each in table.column("color_jpeg").to_pylist() if each]
    assert {Image.open(io.BytesIO(each)).size for each in jpegs} == {(12, 6)}
    assert len(jpegs) >= 2
    bucket, name = open_bucket(batch.store, recorded_location(batch.record()).s3Bucket or ""), "000001-rosbag2"
    for key in bucket.keys(""):
        if key.endswith(("000001.bag", f"{name}/metadata.yaml", f"{name}_0.mcap")):
            bucket.download(key, tmp_path / "bags" / "/".join(key.split("/")[-1 - (name in key) :]))
    for bag in (tmp_path / "bags" / "000001.bag", tmp_path / "bags" / name):
        depths = read_bag(bag, "/camera/depth/image_raw")
        packed = [depth_png(each.data.view("<u2").reshape(8, 12) / 1000.0, 3.0) for each in depths]
        assert packed == [kept[t_s] for t_s in sorted(kept)]
        assert [bytes(each.data) for each in read_bag(bag, "/camera/color/image_raw/compressed")] == jpegs
        assert [each.width for each in read_bag(bag, "/camera/depth/camera_info")] == [12] * len(depths)


PNG = depth_png(np.ones((2, 3)), 3.0)


def _packed(steps: list[int], pictures: list[bytes]) -> list[np.ndarray]:
    lengths = np.array([len(each) for each in pictures], np.int64)
    return [np.array(steps, np.int32), lengths, np.frombuffer(b"".join(pictures), np.uint8)]


NONE = _packed([], [])


def test_pictures_of_a_process_are_taken_apart_by_their_steps():
    found = recorded_pictures.answered(Pictures(), [*_packed([0, 4], [PNG, PNG + b"."]), *NONE], [0, 2, 4])
    assert found == (Pictures(), [{0: PNG, 4: PNG + b"."}, {}])


@pytest.mark.parametrize(
    ("answer", "arrays"),
    [
        (Pictures(), [*_packed([1], [PNG]), *NONE]),  # a step that nobody asked for
        (Pictures(), [*_packed([0, 0], [PNG, PNG]), *NONE]),
        (Pictures(), [*_packed([0], [b"<svg/>"]), *NONE]),
        (Pictures(), [*NONE, *_packed([0], [PNG])]),  # a PNG for a JPEG
        (Pictures(), [np.array([0]), np.array([9]), np.frombuffer(PNG, np.uint8), *NONE]),
        (Pictures(), [np.array([0]), np.array([-1]), np.zeros(0, np.uint8), *NONE]),
        (Pictures(), [np.zeros((1, 1)), np.array([9]), np.frombuffer(PNG, np.uint8), *NONE]),
        (Pictures(), NONE),
        (Crashed(code="RobotApplicationCrash", reason="no"), []),
    ],
)
def test_what_is_no_answer_to_the_question_is_refused(answer: Answer, arrays: list[np.ndarray]):
    with pytest.raises(recorded_pictures.MessageRefused):
        recorded_pictures.answered(answer, arrays, [0, 2])
