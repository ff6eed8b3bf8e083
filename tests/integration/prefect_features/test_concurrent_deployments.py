"""Two runs want one fleet: the second is refused, and the robots of the first go on."""

from pathlib import Path

import pytest

from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import members, read_reported
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.integration.runs import finished, jobs, simyard, write_document

pytestmark = pytest.mark.integration
_WAITS = '#!/bin/sh\nuntil test -e "$RELEASE"; do sleep 0.05; done\n'
_STAYS = "#!/bin/sh\nexec sleep 1000\n"


def _publish(store: Store, folder: Path) -> None:
    package = folder / "bundle/patient"
    package.mkdir(parents=True)
    for name, text in {"before.sh": _WAITS, "run.sh": _STAYS}.items():
        (package / name).write_text(text)
        (package / name).chmod(0o755)
    publish_bundle(store, "robot-application", "patient", package.parent)


def _document(folder: Path, robots: int, release: Path) -> Path:
    launch = {
        "packageName": "patient",
        "preLaunchFile": "before.sh",
        "launchFile": "run.sh",
        "environmentVariables": {"RELEASE": str(release)},
    }
    deployment = {
        "fleet": {"name": "couriers", "localAgents": robots},
        "deploymentApplicationConfigs": [{"application": "patient", "launchConfig": launch}],
    }
    return write_document(folder, {"name": f"deploy-{robots}", "deployment": deployment})


@pytest.mark.long
@pytest.mark.usefixtures("prefect_server")
def test_a_second_run_is_refused_and_touches_nothing_of_the_first(tmp_path: Path):
    store = open_store((tmp_path / "store").as_uri())
    _publish(store, tmp_path)
    release = tmp_path / "release"
    first = simyard("run", str(_document(tmp_path / "first", 2, release)), "--store", store.url)
    try:
        while (reported := read_reported(store, "couriers-1")) is None or reported.step != "ExecutingPreLaunch":
            assert first.poll() is None, first.communicate()
        second = finished("run", str(_document(tmp_path / "second", 1, release)), "--store", store.url)
        joined = [robot.name for robot in members(store, "couriers")]
    finally:
        release.touch()
        out, err = first.communicate()

    assert (second.returncode, "without an active deployment" in second.stderr) == (2, True), second.stderr
    assert first.returncode == 0, out + err
    assert joined == ["couriers-1", "couriers-2"]
    assert [job.status for job in jobs(store)["deployment-job"]] == ["Succeeded"]
