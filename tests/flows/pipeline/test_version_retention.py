"""Room for the 41st version of an application that a document brings along."""

from pathlib import Path

import pytest
from pydantic import JsonValue
from typer.testing import CliRunner

from flows.cli.shell import app
from flows.pipeline import version_retention
from flows.pipeline.version_retention import free_versions, publish_brought, version_lines
from specs.errors import LimitExceeded
from specs.pipeline.document import PipelineSpec
from specs.robomaker.bundle import VERSIONS_AT_MOST, Application, ApplicationKind, Version
from tasks.applications.registry import publish_bundle
from tasks.applications.versions import change, read_application
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance, submit

_COMMAND = r"nothing refers to 1, 2, .*simyard app delete tugger --kind robot --version 1$"
ROBOT: ApplicationKind = "robot-application"
PLAIN = PipelineSpec.model_validate({"name": "nightly", "applications": [{"name": "tugger", "source": "tugger"}]})


def _edit(folder: Path, number: int) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "note.txt").write_text(f"change {number}")
    return folder


def _numbers(store: Store) -> list[int]:
    found = read_application(store, ROBOT, "tugger")
    assert found is not None
    return [version.number for version in found.versions]


@pytest.fixture
def full(file_store: Store, tmp_path: Path) -> Store:
    """Returns a store with 40 versions of tugger that a document brought."""
    first = publish_brought(file_store, ROBOT, "tugger", _edit(tmp_path / "tugger", 1), PLAIN)
    _fill(file_store, first)
    return file_store


def _fill(store: Store, first: Version) -> None:
    """Gives the application 39 versions more, of which only the records are there."""
    more = (first.model_copy(update={"number": n, "digest": f"{n:064x}"}) for n in range(2, VERSIONS_AT_MOST + 1))
    change(store, ROBOT, "tugger", lambda _, __: Application(kind=ROBOT, name="tugger", versions=(first, *more)))


def _change_again(store: Store, folder: Path) -> int:
    return publish_brought(store, ROBOT, "tugger", _edit(folder / "tugger", 99), PLAIN).number


def test_the_41st_change_of_a_documents_robot_takes_the_place_of_the_oldest(full: Store, tmp_path: Path):
    assert _change_again(full, tmp_path) == 41
    assert _numbers(full) == list(range(2, 42))


def test_the_bundle_of_a_version_that_made_room_stays(full: Store, tmp_path: Path):
    found = read_application(full, ROBOT, "tugger")
    assert found is not None
    _change_again(full, tmp_path)
    assert full.exists(bundle_key(found.versions[0].digest))


@pytest.mark.parametrize(
    "section", [{"gate": {"noWorseThan": {"applicationVersion": "1"}}}, {"search": {"over": {}, "against": "1"}}]
)
def test_a_version_that_a_document_compares_with_makes_no_room(
    full: Store, tmp_path: Path, section: dict[str, JsonValue]
):
    submit(full, "pipeline-run", {"flow": "pipeline", "spec": {"name": "other", **section}}, "token")
    _change_again(full, tmp_path)
    assert _numbers(full)[:2] == [1, 3]


def test_a_version_that_an_ended_run_compared_with_makes_no_room(full: Store, tmp_path: Path):
    found = read_application(full, ROBOT, "tugger")
    assert found is not None
    pins = {"comparedWith": found.versions[0].digest}
    run = submit(full, "pipeline-run", {"flow": "pipeline", "pins": {**pins}}, "token")
    advance(full, "pipeline-run", run.id, "Completed")
    _change_again(full, tmp_path)
    assert _numbers(full)[:2] == [1, 3]


def test_a_version_that_an_unfinished_job_tests_makes_no_room_until_the_job_ends(full: Store):
    found = read_application(full, ROBOT, "tugger")
    assert found is not None
    run = submit(full, "simulation-job-batch", {"bundles": [found.versions[0].digest]}, "token")
    assert free_versions(full, ROBOT, "tugger")[0].number == 2
    advance(full, "simulation-job-batch", run.id, "Completed")
    assert free_versions(full, ROBOT, "tugger")[0].number == 1


def test_a_version_that_the_document_itself_names_makes_no_room(full: Store):
    use = {"application": "tugger", "launchConfig": {"packageName": "tugger", "launchFile": "run.sh"}}
    deployment = {"fleet": "tuggers", "deploymentApplicationConfigs": [{**use, "applicationVersion": "1"}]}
    spec = PipelineSpec.model_validate({"name": "ship", "deployment": deployment})
    assert free_versions(full, ROBOT, "tugger", spec)[0].number == 2


def test_the_newest_version_makes_no_room(full: Store):
    assert free_versions(full, ROBOT, "tugger")[-1].number == VERSIONS_AT_MOST - 1


def test_what_a_robot_is_asked_to_run_makes_no_room(full: Store):
    found = read_application(full, ROBOT, "tugger")
    assert found is not None
    full.create("robots/r1/desired.json", f'{{"robot": "r1", "digest": "{found.versions[0].digest}"}}'.encode())
    assert free_versions(full, ROBOT, "tugger")[0].number == 2


def test_the_last_two_deployments_of_a_fleet_make_no_room(full: Store):
    found = read_application(full, ROBOT, "tugger")
    assert found is not None
    for number in (0, 1, 2):
        request = {"fleet": "tuggers", "digest": found.versions[number].digest}
        job = submit(full, "deployment-job", {**request}, f"token {number}")
        advance(full, "deployment-job", job.id, "Succeeded")
    assert [version.number for version in free_versions(full, ROBOT, "tugger")][:2] == [1, 4]


def test_a_run_makes_room_again_where_another_one_took_the_room_that_it_saw(
    full: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    look = version_retention.free_versions

    def look_slowly(store: Store, kind: ApplicationKind, name: str, spec: PipelineSpec) -> list[Version]:
        seen = look(store, kind, name, spec)
        monkeypatch.setattr(version_retention, "free_versions", look)
        assert publish_brought(full, ROBOT, "tugger", _edit(tmp_path / "other", 98), PLAIN).number == 41
        return seen

    monkeypatch.setattr(version_retention, "free_versions", look_slowly)
    assert _change_again(full, tmp_path) == 42
    assert _numbers(full) == list(range(3, 43))


def test_what_a_command_published_makes_no_room(file_store: Store, tmp_path: Path):
    _fill(file_store, publish_bundle(file_store, ROBOT, "tugger", _edit(tmp_path / "tugger", 1)))
    with pytest.raises(LimitExceeded, match=_COMMAND):
        _change_again(file_store, tmp_path)
    assert _numbers(file_store) == list(range(1, 41))


def test_a_command_that_publishes_what_a_document_brought_keeps_it(full: Store, tmp_path: Path):
    publish_bundle(full, ROBOT, "tugger", _edit(tmp_path / "tugger", 1))
    _change_again(full, tmp_path)
    assert _numbers(full)[:2] == [1, 3]


def test_app_publish_at_the_limit_names_the_versions_that_may_go(full: Store, tmp_path: Path):
    folder = _edit(tmp_path / "tugger", 99)
    answer = CliRunner().invoke(app, ["app", "publish", "tugger", str(folder), "--store", full.url])
    assert "simyard app delete tugger --kind robot --version 1" in str(answer.exception)


def test_a_plan_tells_which_version_a_run_deletes(full: Store, tmp_path: Path):
    trial = OverlayStore(full)
    _change_again(trial, tmp_path)
    assert [*version_lines(PLAIN, full, trial)] == [
        "tugger has 40 of at most 40 versions; version 1 is deleted, which nothing refers to"
    ]
    assert _numbers(full)[0] == 1


def test_a_plan_says_nothing_of_an_application_with_few_versions(file_store: Store, tmp_path: Path):
    _change_again(file_store, tmp_path)
    assert not [*version_lines(PLAIN, file_store, file_store)]
