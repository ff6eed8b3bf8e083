from pathlib import Path

from tasks.applications.application_answers import (
    describe_robot_application,
    describe_simulation_application,
    list_robot_applications,
    list_simulation_applications,
)
from tasks.applications.registry import publish_bundle
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id


def _folder(home: Path, content: str) -> Path:
    (home / content).mkdir()
    (home / content / "file").write_text(content)
    return home / content


def test_a_robot_application_is_described_with_the_place_of_its_bundle(file_store: Store, tmp_path: Path) -> None:
    publish_bundle(file_store, "robot-application", "picker", _folder(tmp_path, "one"))
    second = publish_bundle(file_store, "robot-application", "picker", _folder(tmp_path, "two"))

    described = describe_robot_application(file_store, "picker")

    assert described.arn == f"arn:simyard:robot-application:{store_id(file_store)}:picker"
    assert described.version == "2"
    assert [source.s3Key for source in described.sources or ()] == [f"bundles/{second.digest}"]
    assert describe_robot_application(file_store, described.arn or "", "1").version == "1"


def test_a_simulation_application_is_described_as_one(file_store: Store, tmp_path: Path) -> None:
    publish_bundle(file_store, "simulation-application", "picking", _folder(tmp_path, "one"))

    suite = describe_simulation_application(file_store, "picking").simulationSoftwareSuite

    assert suite is not None
    assert suite.name == "SimulationRuntime"


def test_each_kind_of_application_has_its_own_list(file_store: Store, tmp_path: Path) -> None:
    folder = _folder(tmp_path, "one")
    publish_bundle(file_store, "robot-application", "picker", folder)
    publish_bundle(file_store, "simulation-application", "picking", folder)

    assert [summary.name for summary in list_robot_applications(file_store)] == ["picker"]
    assert [summary.name for summary in list_simulation_applications(file_store)] == ["picking"]
