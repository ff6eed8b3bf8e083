"""Episodes that nodes of ROS 2 drive, from the process that asks to their rows: players on Cyclone DDS, no ROS 2."""

import shutil
from collections.abc import Mapping
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.chunk.byproducts import JobTags
from tasks.simulate.lane.result_rows import WITHDRAWN
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.sandbox import process_pool
from tasks.simulate.sandbox.sandbox_client import SandboxClient
from tests.factories.simulations import BUNDLES, DRIFT, FOLDERS, pushing, simulate_lanes
from tests.ros.ros2.players import make_bundle

pytestmark = pytest.mark.long

PLAY = "6" * 64
ROBOT = ApplicationLaunch(name="play", version="1", digest=PLAY, package="play", launch_file="play.launch.py")
PROGRAMS = ("avoider", "faulty", "not_a_number", "service_caller", "avoider", "hasty", "pilot")
LANES, SECONDS = 8, 1.0


def chunk_of(*programs: str) -> Chunk:
    asked: list[EpisodeRequest] = [
        pushing(index, world="hand/pen-0", seed=1, duration_s=SECONDS).model_copy(
            update={"robot": ROBOT, "environment": {"PROGRAM": program}}
        )
        for index, program in enumerate(programs)
    ]
    return Chunk(number=0, requests=tuple(asked))


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    """The unpacked bundles: a robot whose nodes play ROS 2's, and what it is tried with."""
    bundle = make_bundle(tmp_path_factory.mktemp("play") / "bundle")
    shutil.copy(BUNDLES / "patrol/robot.xml", bundle)
    return {PLAY: bundle, DRIFT: FOLDERS[DRIFT]}


@pytest.fixture(scope="module")
def alone(folders: Mapping[str, Path], pens: dict[str, World]) -> EpisodeResult:
    """The row of a sound episode, simulated in this process with nothing beside it."""
    (row,) = simulate_lanes(chunk_of("avoider"), pens, folders, lanes=LANES, should_stop=lambda: False)
    return row


def test_a_sound_episode_is_driven_in_lock_step(alone: EpisodeResult):
    assert (alone.status, alone.outcome_reason, alone.simulated_s) == ("Completed", "timeout", SECONDS)
    assert (alone.late, alone.stray) == (0, 0)
    assert alone.path_length_m > 0.1


@pytest.mark.parametrize("level", ["bubblewrap", "landlock", pytest.param("process", marks=pytest.mark.soak)])
def test_each_fault_is_its_own_episodes_row_in_either_confinement(
    folders: Mapping[str, Path],
    alone: EpisodeResult,
    pens: dict[str, World],
    level: str,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setenv("SIMYARD_CONFINEMENT", level)
    tags: JobTags = {}
    shut_in = SandboxClient(bundles=folders, lanes=LANES, engine="auto", should_stop=lambda: False, tagged=tags.update)
    try:
        rows = list(shut_in.simulate(chunk_of(*PROGRAMS), pens))
    finally:
        process_pool._idle.end_all()
    assert [rows[number].model_copy(update={"index": 0}) for number in (0, 4)] == [alone, alone]
    assert {rows[number].failure_code for number in (1, 2, 6)} == {"RobotApplicationCrash"}
    assert "the lidar is on fire" in rows[1].failure_reason
    assert "/cmd_vel: a command is not a number" in rows[2].failure_reason
    assert (rows[3].status, rows[3].failure_reason) == ("Canceled", WITHDRAWN)
    assert tags == {3: {"room": "kitchen"}}
    # A command by the wall's clock comes while the lane is quiet, or keeps it from its rest: the columns say either.
    assert rows[5].late or rows[5].stray
    assert "the package play has no executable 'pilot'" in rows[6].failure_reason
