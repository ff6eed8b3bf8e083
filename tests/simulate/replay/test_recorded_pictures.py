"""Recordings with pictures: what is kept is what the robot saw, the same bytes each time, and nothing strange."""

import io
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from mcap.reader import make_reader
from PIL import Image

from flows.batch.replay_episode import replay_job
from specs.data.people import People
from specs.pipeline.simulation_section import Recordings
from tasks.results.playback.replay_mcap import write_mcap
from tasks.results.playback.robot_view import robot_views
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

PAIRS = (
    SEER.partition("\n\ndef controller")[0]
    + """

class Rear(Depth):
    name, yaw_rad, x_m, sigma_m_per_m2 = "rear", 3.1, -0.1, 0.0


class Left(Eye):
    name, y_m, rows = "left", 0.06, 16


class Right(Left):
    name, y_m = "right", -0.06


class Front(Depth):
    name = "front"


class Pairs(Seer):
    depth_camera, color_camera = [Front(), Rear()], (Left(), Right())

    def step(self, observation):
        assert observation.depth_m.shape == (2, 8, 12) and observation.color.shape == (2, 16, 12, 3)
        return super().step(observation)


def controller(environment):
    return Pairs()
"""
)


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


@pytest.mark.long
def test_pictures_of_cameras_in_a_list_are_one_above_the_other_and_apart_in_bags(tmp_path: Path):
    batch = seeing_batch(tmp_path, robot=PAIRS)
    again = replay_job(batch.store, f"{batch.id}/1")
    if "InternalServiceError" in {each.recorded for each in again.deviations if each.column == "failure_code"}:
        skip_or_fail("no GL draws")
    assert again.same
    assert again.playback
    films = [again.playback.depth, again.playback.color]
    for film, names in zip(films, (["front", "rear"], ["left", "right"]), strict=True):
        assert film
        assert [each.camera.name for each in film.apart] == names
        assert all((one != other).any() for one, other in zip(*(each.pictures for each in film.apart), strict=True))
    assert [view.label.partition(":")[0] for view in robot_views(again.playback)] == ["front", "rear", "left", "right"]
    table = recording(batch, 1)
    pngs, jpegs = ([each for each in table.column(name).to_pylist() if each] for name in ("depth_png", "color_jpeg"))
    assert {Image.open(io.BytesIO(each)).size for each in pngs} == {(12, 16)}
    assert {Image.open(io.BytesIO(each)).size for each in jpegs} == {(12, 32)}
    bucket = open_bucket(batch.store, recorded_location(batch.record()).s3Bucket or "")
    (key,) = (key for key in bucket.keys("") if key.endswith("000001.bag"))
    bucket.download(key, tmp_path / "one.bag")
    for place, name in enumerate(("front", "rear")):
        depths = read_bag(tmp_path / "one.bag", f"/{name}/camera/depth/image_raw")
        kept = [np.asarray(Image.open(io.BytesIO(each)))[place * 8 : place * 8 + 8] for each in pngs]
        assert [each.data.view("<u2").reshape(8, 12).tolist() for each in depths] == [each.tolist() for each in kept]
        assert {each.header.frame_id for each in depths} == {f"{name}_camera_depth_optical_frame"}
    for place, name in enumerate(("left", "right")):
        drawn = read_bag(tmp_path / "one.bag", f"/{name}/camera/color/image_raw/compressed")
        assert len(drawn) == len(jpegs)
        for each, both in zip(drawn, jpegs, strict=True):
            half = np.asarray(Image.open(io.BytesIO(both)), float)[place * 16 : place * 16 + 16]
            assert np.abs(np.asarray(Image.open(io.BytesIO(bytes(each.data))), float) - half).mean() < 4.0
    write_mcap(tmp_path / "replay.mcap", PENS["hand/pen-0"], again.playback)
    with (tmp_path / "replay.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary
        topics = {each.topic for each in summary.channels.values()}
    assert topics >= {"/front/depth", "/rear/depth/calibration", "/left/color", "/right/color/calibration"}


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
