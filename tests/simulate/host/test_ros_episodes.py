"""Episodes that nodes of ROS 1 drive, from the process that asks to their rows: faults, sandbox, replay, audit."""

import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.ros.launch.packages import RosInstallation
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.chunk.byproducts import JobTags
from tasks.simulate.host import declaration
from tasks.simulate.lane.result_rows import WITHDRAWN
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.replay.replay_drive import drive_replay
from tasks.simulate.sandbox import process_pool
from tasks.simulate.sandbox.sandbox_client import SandboxClient, TooManyLanes, retry_with_fewer_lanes
from tests.factories.audits import audit
from tests.factories.simulations import BUNDLES, DRIFT, FOLDERS, pushing, simulate_lanes
from tests.repository import ROOT
from tests.servers.eventually import eventually

pytestmark = pytest.mark.long

PATROL = "7" * 64
ROBOT = ApplicationLaunch(name="patrol", version="1", digest=PATROL, package="patrol", launch_file="patrol.launch")
FOLDERS_USED = {PATROL: BUNDLES / "patrol", DRIFT: FOLDERS[DRIFT]}
KINDS = ("none", "crash:20", "nan:20", "cancel:20", "tags:20", "orphan:20", "look:20")
SOUND = (0, 4, 5, 6)
LANES, SECONDS = 8, 1.0
# In the environment of each node of these tests, and of none that somebody else started meanwhile.
OWN = str(os.getpid())


def requests(*kinds: str) -> list[EpisodeRequest]:
    return [
        pushing(index, world="hand/pen-0", seed=1, duration_s=SECONDS).model_copy(
            update={"robot": ROBOT, "environment": {"KIND": kind, "SPEED": "0.4", "OWN": OWN}}
        )
        for index, kind in enumerate(kinds)
    ]


def chunk_of(asked: list[EpisodeRequest]) -> Chunk:
    return Chunk(number=0, requests=tuple(asked))


def marked(mark: str) -> list[int]:
    """Returns the processes that have a mark in their environment."""
    found: list[int] = []
    for each in Path("/proc").iterdir():
        if each.name.isdecimal():
            try:
                if mark.encode() in (each / "environ").read_bytes():
                    found.append(int(each.name))
            except OSError:
                continue
    return found


def sound_part(row: EpisodeResult) -> Mapping[str, object]:
    return row.model_dump(exclude={"index"})


class Told:
    """What a process that simulates told besides rows."""

    def __init__(self) -> None:
        self.tags: JobTags = {}
        self.printed = ""

    def tag(self, tags: JobTags) -> None:
        self.tags |= tags

    def hear(self, text: str) -> None:
        self.printed += text


def confined(told: Told) -> SandboxClient:
    return SandboxClient(
        bundles=FOLDERS_USED, lanes=LANES, engine="auto", should_stop=lambda: False, tagged=told.tag, printed=told.hear
    )


@pytest.fixture(scope="module")
def alone(ros: RosInstallation, pens: dict[str, World]) -> EpisodeResult:
    """The row of a sound episode, simulated in this process with nothing beside it."""
    (row,) = simulate_lanes(chunk_of(requests("none")), pens, FOLDERS_USED, lanes=LANES, should_stop=lambda: False)
    return row


def test_a_sound_episode_is_driven_in_lock_step(alone: EpisodeResult):
    assert (alone.status, alone.outcome_reason, alone.simulated_s) == ("Completed", "timeout", SECONDS)
    assert (alone.late, alone.stray) == (0, 0)
    assert alone.path_length_m > 0.2


@pytest.mark.parametrize("level", ["bubblewrap", "landlock", pytest.param("process", marks=pytest.mark.soak)])
def test_each_fault_is_its_own_episodes_row_in_either_confinement(
    alone: EpisodeResult, pens: dict[str, World], level: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_CONFINEMENT", level)
    told = Told()
    try:
        rows = list(confined(told).simulate(chunk_of(requests(*KINDS)), pens))
    finally:
        process_pool._idle.end_all()
    assert [sound_part(rows[number]) for number in SOUND] == [sound_part(alone)] * len(SOUND)
    assert rows[1].failure_reason == "patrol: node /wander ended with status 7: I give up"
    assert "job 1 of patrol:\nwander: I give up" in told.printed
    assert "/cmd_vel: a command is not a number" in rows[2].failure_reason
    assert {rows[number].failure_code for number in (1, 2)} == {"RobotApplicationCrash"}
    assert (rows[3].status, rows[3].failure_reason) == ("Canceled", WITHDRAWN)
    assert told.tags == {4: {"found": "a wall"}}
    hidden = "job 6 of patrol:\nwander: host files: False" in told.printed
    assert hidden or level == "process"
    assert not marked(f"OWN={OWN}")


def test_rows_do_not_depend_on_how_many_lanes_run_at_once(
    alone: EpisodeResult, pens: dict[str, World], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(declaration, "_LANES_A_CORE", 1)
    asked = requests(*["none"] * 9)
    with pytest.raises(TooManyLanes, match="9 ROS applications at once"):
        confined(Told()).simulate(chunk_of(asked), pens)
    fitted = retry_with_fewer_lanes(
        chunk_of(asked), 16, lambda part, _: confined(Told()).simulate(part, pens), lambda: False
    )
    assert fitted.lanes == declaration.FEWEST_LANES
    assert [sound_part(row) for row in fitted.rows] == [sound_part(alone)] * len(asked)


def test_a_replay_gives_the_same_row_and_all_its_steps(alone: EpisodeResult, pens: dict[str, World]):
    again = drive_replay(requests("none")[0], pens, FOLDERS_USED, lanes=LANES, engine="planar", rate_hz=4.0)
    assert again.row == alone
    assert again.steps is not None


def test_an_audit_makes_the_row_again(alone: EpisodeResult, pens: dict[str, World]):
    found = audit([SampledEpisode(requests("none")[0], alone, weight=1.0)], pens, FOLDERS_USED, lanes=LANES)
    assert (found.unreproduced, found.unlocked, found.ros, found.compared) == ((), (), 1, 1)


def test_an_audit_names_a_row_whose_lock_step_did_not_hold(alone: EpisodeResult, pens: dict[str, World]):
    unlocked = alone.model_copy(update={"late": 1})
    found = audit([SampledEpisode(requests("none")[0], unlocked, weight=1.0)], pens, FOLDERS_USED, lanes=LANES)
    assert (found.unreproduced, found.unlocked) == ((), (0,))
    assert "lock-step did not hold in 1 of 1 episodes (0)" in found.sentence


_RUN = """
import sys
from tests.simulate.conftest import pen
from tests.simulate.host.test_ros_episodes import chunk_of, confined, requests, Told
asked = [each.model_copy(update={"duration_s": 600.0}) for each in requests(*["none"] * 3)]
marks = [each.model_copy(update={"environment": {**each.environment, "MARK": sys.argv[1]}}) for each in asked]
confined(Told()).simulate(chunk_of(marks), {"hand/pen-0": pen(4.5, 0)})
"""


@pytest.mark.parametrize("level", ["bubblewrap", "landlock", "process"])
def test_no_node_survives_a_run_that_is_killed(ros: RosInstallation, level: str):
    mark = f"{os.getpid()}-{level}"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "SIMYARD_CONFINEMENT": level}
    with subprocess.Popen([sys.executable, "-c", _RUN, mark], env=environment, cwd=ROOT) as run:
        try:
            eventually(lambda: len(marked(f"MARK={mark}")) >= 3 or run.poll() is not None)
            assert run.poll() is None
        finally:
            run.send_signal(signal.SIGKILL)
    eventually(lambda: not marked(f"MARK={mark}"))
