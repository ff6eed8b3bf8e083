"""Episodes that a simulation application of ROS judges: by tags, its nodes' ends, or time; alone or beside another."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.ros.launch.packages import RosInstallation
from tasks.simulate.chunk.byproducts import collect_tags
from tasks.simulate.lane.result_rows import WITHDRAWN
from tasks.simulate.plan.chunks import Chunk
from tests.factories.simulations import BUNDLES, DRIFT, FOLDERS, pushing, simulate_lanes
from tests.repository import ROOT

pytestmark = pytest.mark.long

EXAMINER, PATROL = "6" * 64, "7" * 64
LANES, SECONDS = 8, 3.0
RESETS = ("reset_simulation", "reset_world") * 2
Drive = Callable[..., list[EpisodeResult]]


def launch(name: str, digest: str, file: str) -> ApplicationLaunch:
    return ApplicationLaunch(name=name, version="1", digest=digest, package=name, launch_file=file)


@pytest.fixture(scope="module")
def bundle(ros: RosInstallation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulation application with the robot that it drives itself, if it is alone."""
    folder = tmp_path_factory.mktemp("examiner")
    shutil.copytree(ROOT / "tests/data/ros/examiner", folder / "examiner")
    shutil.copy(BUNDLES / "patrol/robot.xml", folder / "robot.xml")
    return folder


@pytest.fixture
def drive(bundle: Path, pens: dict[str, World]) -> Drive:
    """Drives episodes, one for each set of variables."""

    def run(
        file: str,
        *variables: Mapping[str, str],
        robot: ApplicationLaunch | None = None,
        seconds: float = SECONDS,
        engine: str = "auto",
        judging: dict[str, str] | None = None,
    ) -> list[EpisodeResult]:
        judge = launch("examiner", EXAMINER, file)
        asked = [
            pushing(index, world="hand/pen-0", seed=1, duration_s=seconds).model_copy(
                update={
                    "robot": robot or judge,
                    "scenario": judge,
                    "environment": {**each},
                    "judge_environment": judging,
                }
            )
            for index, each in enumerate(variables)
        ]
        folders = {EXAMINER: bundle, PATROL: BUNDLES / "patrol", DRIFT: FOLDERS[DRIFT]}
        return list(
            simulate_lanes(chunk_of(asked), pens, folders, lanes=LANES, should_stop=lambda: False, engine=engine)
        )

    return run


def chunk_of(asked: list[EpisodeRequest]) -> Chunk:
    return Chunk(number=0, requests=tuple(asked))


def ending(row: EpisodeResult) -> tuple[str, str, str, str]:
    return row.status, row.outcome, row.outcome_reason, row.failure_reason


def test_tags_decide_and_cancel_ends_the_episode_at_that_time(drive: Drive):
    passed, failed = drive("alone.launch", {"SPEED": "0.4"}, {"SPEED": "0.1", "LIMIT": "2.5"})
    assert ending(passed) == ("Completed", "Passed", "", "")
    assert ending(failed) == ("Completed", "Failed", "judged", "")
    assert 0.5 < passed.simulated_s < failed.simulated_s < SECONDS
    assert 0.3 <= passed.metrics["distance"] < 0.35
    assert (passed.late, passed.stray, passed.goals_total) == (0, 0, 0)


def test_a_cancelled_episode_of_which_no_tag_says_anything_has_no_outcome(drive: Drive):
    (row,) = drive("alone.launch", {"HOW": "cancel"})
    assert ending(row) == ("Canceled", "Failed", "", WITHDRAWN)


@pytest.mark.parametrize(
    ("file", "how"), [("test.launch", "junit"), ("test.launch", "exit"), ("required.launch", "exit")]
)
def test_the_end_of_a_test_node_decides(drive: Drive, file: str, how: str, capsys: pytest.CaptureFixture[str]):
    passed, failed = drive(file, {"HOW": how}, {"HOW": how, "SPEED": "0.1", "LIMIT": "2.5"})
    assert ending(passed) == ("Completed", "Passed", "", "")
    assert ending(failed) == ("Completed", "Failed", "judged", "")
    assert passed.simulated_s < failed.simulated_s < SECONDS
    assert (file == "required.launch") != ('drives.xml: <testsuite tests="1" failures="1">' in capsys.readouterr().out)


def test_an_episode_whose_time_is_over_fails_unless_its_bundle_declares_that_it_passes(drive: Drive, bundle: Path):
    (row,) = drive("alone.launch", {"HOW": "nothing"}, seconds=1.0)
    assert ending(row) == ("Completed", "Failed", "timeout", "")
    declaration = bundle / "ros.yaml"
    try:
        declaration.write_text("time_over: passed\n")
        (row,) = drive("alone.launch", {"HOW": "nothing", "AGAIN": "x"}, seconds=1.0)
    finally:
        declaration.unlink()
    assert (ending(row), row.simulated_s) == (("Completed", "Passed", "", ""), 1.0)


def test_the_nodes_of_both_applications_run_together_and_what_they_print_is_kept_apart(
    drive: Drive, capsys: pytest.CaptureFixture[str]
):
    patrol = launch("patrol", PATROL, "patrol.launch")
    passed, crashed = drive(
        "examine.launch", {"KIND": "none", "FAR": "0.2"}, {"KIND": "crash:20", "FAR": "0.2"}, robot=patrol
    )
    assert ending(passed) == ("Completed", "Passed", "", "")
    assert (crashed.status, crashed.failure_code) == ("Failed", "RobotApplicationCrash")
    assert "robot application:\nwander: I give up" in (said := capsys.readouterr().out)
    assert "simulation application:\nexamine: gone 0.2" in said


def test_each_applications_nodes_have_its_own_variables(drive: Drive, capsys: pytest.CaptureFixture[str]):
    patrol = launch("patrol", PATROL, "patrol.launch")
    (row,) = drive("examine.launch", {"KIND": "none", "FAR": "9"}, robot=patrol, judging={"FAR": "0.2"})
    assert ending(row) == ("Completed", "Passed", "", "")
    assert "simulation application:\nexamine: gone 0.2" in capsys.readouterr().out


def test_a_crash_of_its_own_nodes_is_the_simulation_applications(drive: Drive):
    patrol = launch("patrol", PATROL, "patrol.launch")
    (row,) = drive("examine.launch", {"FAR": "no number"}, robot=patrol)
    assert (row.status, row.failure_code) == ("Failed", "SimulationApplicationCrash")
    assert "node /examine ended with status 1: ValueError" in row.failure_reason


def test_rows_are_the_same_each_time_and_beside_others(drive: Drive):
    (alone,) = drive("test.launch", {"HOW": "junit"})
    together = drive("test.launch", *[{"HOW": "junit"}] * LANES)
    assert {each.model_copy(update={"index": 0}) == alone for each in together} == {True}


def test_gazebos_services_say_where_the_robot_is_and_that_nothing_else_moves(drive: Drive):
    with collect_tags() as given:
        (row,) = drive("look.launch", {"SPEED": "0.4"})
    assert ending(row) == ("Completed", "Passed", "", "")
    assert (row.late, row.stray) == (0, 0)
    tags = given[0]
    assert (tags["same"], tags["models"], tags["step"], tags["time"]) == ("True", "ground_plane rover", "0.005", "0.00")
    assert 0.3 < float(tags["speed"]) < 0.5
    assert tags["other"] == "chair relative to : only rover the robot relative to the world is known"
    assert tags["set"].startswith("SetModelState: chair stands still here as all but rover")


@pytest.mark.parametrize("engine", ["planar", "mujoco", "mjx"])
def test_a_robot_is_set_elsewhere_at_that_control_step_and_its_row_says_so(drive: Drive, engine: str):
    """By the service, by the topic, and back to its start; the way that it was carried is no way that it drove."""
    with collect_tags() as given:
        rows = drive("move.launch", *[{"SPEED": "0.2", "RESET": reset} for reset in RESETS], engine=engine)
    assert {ending(row) for row in rows} == {("Completed", "Passed", "", "")}
    assert {row.metrics["set_by_hand"] for row in rows} == {3.0}
    assert all(row.path_length_m < 0.5 for row in rows)
    tags = given[0]
    assert (tags["set"], tags["there"], tags["same"]) == ("True", "-1 0.5", "True")
    assert tags["chair"].startswith("SetModelState: chair stands still here")
    assert tags["slow"].startswith("SetPhysicsProperties: steps have 0.005 s here")
    for name, place in {"service": (-1.0, 0.5), "topic": (0.25, -0.75), "reset": (0.0, 0.0)}.items():
        assert [float(each) for each in tags[name].split()] == pytest.approx(place, abs=0.05)
    first, *others = [row.model_copy(update={"index": 0, "late": 0}) for row in rows]
    assert {each == first for each in others} == {True}
