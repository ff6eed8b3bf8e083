"""`simyard list` prints all of a kind, or one page of it, filtered as RoboMaker's List calls filter."""

import json

import pytest
from typer.testing import CliRunner, Result

from flows.cli.shell import app
from specs.errors import DocumentError
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun


def listing(store: Store, *arguments: str) -> Result:
    return CliRunner().invoke(app, ["list", *arguments, "--store", store.url], catch_exceptions=False)


@pytest.fixture
def robots(file_store: Store) -> Store:
    """A store with five robots, two of which are in a fleet."""
    create_fleet(file_store, "couriers")
    for number in range(5):
        create_robot(file_store, f"r{number}")
    for name in ("r1", "r3"):
        register_robot(file_store, "couriers", name)
    return file_store


def test_where_nothing_is_listed_it_is_said_and_where_episodes_that_did_not_pass_are(file_store: Store):
    told = listing(file_store, "worlds")
    assert (told.stdout, told.stderr) == ("", "there are no worlds\n")
    told = listing(file_store, "simulation-jobs", "--filter", "status=Failed")
    assert told.stdout == ""
    assert told.stderr.startswith("there are no simulation-jobs that fit the filter: ")
    assert "simyard report BATCH shows the episodes that did not pass" in told.stderr


def test_pages_of_robots_follow_one_another_and_hold_each_once(robots: Store):
    names: list[str] = []
    token: list[str] = []
    for size in (2, 2, 1):
        answer = json.loads(listing(robots, "robots", "--json", "--max-results", "2", *token).stdout)
        assert len(answer["robots"]) == size
        names += [robot["name"] for robot in answer["robots"]]
        token = ["--next-token", answer["nextToken"]] if "nextToken" in answer else []
    assert (names, token) == ([f"r{number}" for number in range(5)], [])


def test_a_page_in_the_terminal_names_the_next_one(robots: Store):
    shown = listing(robots, "robots", "--max-results", "1")
    assert shown.stderr.startswith("the next page: --next-token ")
    following = listing(robots, "robots", "--max-results", "1", "--next-token", shown.stderr.split()[-1])
    assert [line.split()[1] for line in following.stdout.splitlines()[1:]] == ["r1"]
    assert [line.split()[1] for line in shown.stdout.splitlines()[1:]] == ["r0"]
    assert "the next page" not in listing(robots, "robots", "--max-results", "9").stderr


@pytest.mark.parametrize(
    ("filters", "names"),
    [
        (["fleetName=couriers"], ["r1", "r3"]),
        (["status=Available"], ["r0", "r2", "r4"]),
        (["status=Available", "status=Registered"], ["r0", "r1", "r2", "r3", "r4"]),
    ],
)
def test_filters_are_alternatives(robots: Store, filters: list[str], names: list[str]):
    options = [word for each in filters for word in ("--filter", each)]
    answer = json.loads(listing(robots, "robots", "--json", *options).stdout)
    assert [robot["name"] for robot in answer["robots"]] == names


def test_without_the_options_a_list_is_whole(robots: Store):
    lines = listing(robots, "robots", "--json").stdout.splitlines()
    assert [json.loads(line)["name"] for line in lines] == [f"r{number}" for number in range(5)]


@pytest.mark.parametrize(
    ("kind", "answer"),
    [
        ("fleets", "fleetDetails"),
        ("deployment-jobs", "deploymentJobs"),
        ("simulation-jobs", "simulationJobSummaries"),
        ("simulation-job-batches", "simulationJobBatchSummaries"),
        ("worlds", "worldSummaries"),
        ("world-templates", "templateSummaries"),
        ("world-generation-jobs", "worldGenerationJobSummaries"),
        ("world-export-jobs", "worldExportJobSummaries"),
        ("robot-applications", "robotApplicationSummaries"),
        ("simulation-applications", "simulationApplicationSummaries"),
        ("pipeline-runs", "runSummaries"),
    ],
)
def test_other_kinds_have_pages_too(robots: Store, kind: str, answer: str):
    begun(robots)
    assert answer in json.loads(listing(robots, kind, "--json", "--max-results", "1").stdout)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["robots", "--filter", "colour=red"], "colour"),
        (["robots", "--next-token", "made-up"], "nextToken"),
        (["robots", "--filter", "status"], "filters"),
        (["robots", "--filter", "status=Failed", "--filter", "fleetName=couriers"], "of one name"),
        (["world-templates", "--filter", "status=Failed"], "filters"),
        (["deployment-jobs", "--max-results", "0"], "1 to 200"),
        (["deployment-jobs", "--max-results", "201"], "1 to 200"),
        (["simulation-jobs", "--max-results", "-1"], "1 to 1000"),
        (["simulation-jobs", "--max-results", "-5"], "1 to 1000"),
        (["simulation-jobs", "--max-results", "1001"], "1 to 1000"),
    ],
)
def test_what_robomaker_would_not_take_is_refused(robots: Store, arguments: list[str], said: str):
    with pytest.raises(DocumentError, match=said):
        listing(robots, *arguments)


def test_without_a_kind_it_names_the_kinds(file_store: Store):
    answer = CliRunner().invoke(app, ["list", "--store", file_store.url])
    assert (answer.exit_code, "simulation-job-batches" in answer.stderr) == (2, True)
