"""Strangers' code in a run: it judges no batch by ending its process, can be interrupted, and finds no key.

On commit d54b1a2 controllers ran in the process that holds keys and the exit code. One that raises, writes files or
looks for keys: tests/simulate/sandbox/test_sandbox_client.py.
"""

import os
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from tasks.applications.registry import publish_bundle
from tasks.storage.store_url import open_store
from tests.attacks.conftest import Owner, Writer, attacked_python
from tests.factories.gateway.served import Served, served
from tests.flows.gateway.asked import Asked
from tests.integration.runs import write_document
from tests.repository import ROOT

pytestmark = pytest.mark.integration
_INCONCLUSIVE, _INTERRUPTED = 4, 130
# From the beginning of a chunk to a controller's third step. Nothing tells from outside that it sleeps; before it does,
# the run can be interrupted anyway.
_UNTIL_IT_HANGS_S = 10.0
_CONTROLLER = """
import os
import sys
import time

jax = False


def hurt():
    {hurt}


class Stranger:
    def __init__(self):
        self.steps = 0

    def reset(self, floor, goals_m):
        pass

    def step(self, observation):
        self.steps += 1
        if self.steps == 3:
            hurt()
        return [0.1, 0.0, 0.1]


def controller(environment):
    return Stranger()
"""


# Where secrets are: in the process that started this one, in all others, and in files.
_LOOKS = """
    others = (f"/proc/{{each}}/environ" for each in os.listdir("/proc") if each.isdigit())
    for place in (f"/proc/{{os.getppid()}}/environ", *others, *{files!r}):
        try:
            with open(place, "rb") as file:
                print("found", file.read(), flush=True)
        except OSError as exc:
            print("nothing", exc, flush=True)
    print("it has", "looked", flush=True)  # which stands in no bundle
    time.sleep(1.0)  # until older versions have read it
"""


def _write_stranger(folder: Path, hurt: str) -> None:
    """Writes the bundle of a stranger's robot application."""
    (folder / "stranger").mkdir(parents=True)
    (folder / "robot.xml").write_bytes((ROOT / "applications/courier/robot.xml").read_bytes())
    (folder / "stranger/drive.py").write_text(_CONTROLLER.format(hurt=hurt))


def _document(owner: Owner, hurt: str) -> str:
    """Returns a document whose robot application is a stranger's; its gate asks for nothing but an answer."""
    _write_stranger(owner.folder / "stranger", hurt)
    return _document_of(owner, [_request("stranger", "stranger", "drive", duration_s=2)], {"worldCount": 1, "seeds": 2})


def _request(application: str, package: str, launch_file: str, *, duration_s: int, **more: str) -> dict[str, object]:
    """Returns a request for jobs of a robot application in the scenario that Simyard brings along."""
    launch = {"packageName": "delivery", "launchFile": "rooms"}
    robot = {"application": application, "launchConfig": {"packageName": package, "launchFile": launch_file}, **more}
    return {
        "maxJobDurationInSeconds": duration_s,
        "robotApplications": [robot],
        "simulationApplications": [{"application": "delivery", "launchConfig": launch}],
    }


def _document_of(owner: Owner, requests: list[dict[str, object]], counts: dict[str, int], **gate: object) -> str:
    """Returns a document whose robot application lies in the owner's folder ``stranger``."""
    document = {
        "name": "stranger",
        "applications": [{"name": "stranger", "kind": "robot", "source": "stranger"}],
        "worldGeneration": {
            "template": "templates/two-rooms.json",
            "worldCount": {"floorplanCount": counts["worldCount"], "interiorCountPerFloorplan": 1},
        },
        "simulationBatch": {
            "createSimulationJobRequests": requests,
            "matrix": {"worlds": "all", "seeds": counts["seeds"]},
            "outputLocation": {"s3Bucket": "results", "s3Prefix": "attacks"},
            "audit": {"lanes": 0},
        },
        "gate": {"successRate": {"atLeast": 0.5}, **gate},
    }
    return str(write_document(owner.folder, document))


def test_a_controller_that_ends_its_process_turns_no_pipeline_green(owner: Owner, writer: Writer):
    """A controller exits with 0, so that CI sees a green run with nothing judged; it has a process of its own."""
    ended = owner.simyard("run", _document(owner, "os._exit(0)"), "--direct")
    assert ended.returncode == _INCONCLUSIVE, ended.stdout
    assert "The gate says INCONCLUSIVE" in ended.stdout
    said = "exit code 0"
    assert said in ended.stdout or any(said.encode() in writer.get(key) for key in writer.keys("jobs/"))


@pytest.mark.usefixtures("prefect_server")
def test_a_run_whose_controller_hangs_can_be_interrupted(owner: Owner, writer: Writer):
    """A controller sleeps for ever, so that the run can be neither ended nor cancelled; its process is killed."""
    run = owner.start("run", _document(owner, "time.sleep(10_000)"))
    while not any("/000000.started" in key for key in writer.keys("chunks/")):
        assert run.poll() is None, run.communicate()[0]
        time.sleep(0.1)
    time.sleep(_UNTIL_IT_HANGS_S)
    run.send_signal(signal.SIGINT)
    told, _ = run.communicate()
    assert run.returncode == _INTERRUPTED, told
    assert "the same command continues this run" in told


@pytest.fixture
def place_in_opt() -> Iterator[Path]:
    """A folder below /opt, where it can be made; elsewhere a folder beside the tests' own."""
    folder = Path(tempfile.mkdtemp(dir="/opt" if os.access("/opt", os.W_OK) else None))
    yield folder
    shutil.rmtree(folder)


def _without_bubblewrap(folder: Path) -> str:
    """Returns a PATH with all programs but that one."""
    folder.mkdir()
    for place in map(Path, os.environ["PATH"].split(os.pathsep)):
        for program in place.iterdir() if place.is_dir() else ():
            if program.name != "bwrap" and not (folder / program.name).is_symlink():
                (folder / program.name).symlink_to(program)
    return str(folder)


@pytest.mark.parametrize("way", ["bubblewrap", "no bubblewrap", "a Python called by a path with .."])
def test_a_controller_finds_no_secret_of_its_owner(
    owner: Owner, writer: Writer, tmp_path: Path, place_in_opt: Path, way: str
):
    """A controller prints what it can read of the run's environment and of key files, and anybody reads its output.

    On commit 1b6713fb it found the keys below /opt in bubblewrap, and everything without it or by a path with ``..``.
    """
    secrets = [owner.environment.get("AWS_SECRET_ACCESS_KEY") or uuid4().hex, *(uuid4().hex for _ in range(2))]
    key, other = owner.folder / "key", place_in_opt / "key"
    key.write_text(secrets[1])
    other.write_text(secrets[2])
    looks = _LOOKS.format(files=[str(key), str(other)]).strip()
    path = _without_bubblewrap(tmp_path / "programs") if way == "no bubblewrap" else os.environ["PATH"]
    ended = owner.simyard(
        "run",
        _document(owner, looks),
        "--direct",
        around="path" in way,
        PATH=path,
        AWS_SECRET_ACCESS_KEY=secrets[0],
    )
    written = b"".join(map(writer.get, writer.keys("")))
    assert not [each for each in secrets if each.encode() in written or each in ended.stdout]
    assert b"it has looked" in written, ended.stdout
    assert ended.returncode == _INCONCLUSIVE


@pytest.mark.long
@pytest.mark.parametrize("way", ["bubblewrap", "no bubblewrap", "nothing"])
def test_with_a_key_that_may_simulate_nobody_gets_the_secrets_of_a_gateway(
    tmp_path: Path, prefect_server: str, way: str
):
    """Whoever has a key with that right has a controller run by the gateway's own worker, and reads what it prints.

    On commit 1b6713fb it read the file with all keys, and the worker's environment, where bubblewrap was not.
    """
    home, secrets = tmp_path / "home", [uuid4().hex for _ in range(3)]
    for file, secret in ((".config/simyard/access-keys", secrets[0]), (".aws/credentials", secrets[1])):
        (home / file).parent.mkdir(parents=True)
        (home / file).write_text(secret)
    settings = {"HOME": str(home), "XDG_CONFIG_HOME": str(home / ".config"), "AWS_SECRET_ACCESS_KEY": secrets[2]}
    settings |= {"PREFECT_API_URL": prefect_server, "PYTHONPATH": ""}
    if way == "no bubblewrap":
        settings["PATH"] = _without_bubblewrap(tmp_path / "programs")
    if way == "nothing":
        settings["SIMYARD_CONFINEMENT"] = "process"
    with served(tmp_path / "served", workers=1, settings=settings, python=attacked_python()) as gateway:
        files = [gateway.keys, *home.glob(".*/**/*"), tmp_path / "served/cache/owner/key"]
        described = _batch_of_a_stranger(gateway, tmp_path, _LOOKS.format(files=[*map(str, files)]).strip())
        secrets.append(gateway.owner.secret)
    written = b"".join(path.read_bytes() for path in gateway.store.rglob("*") if path.is_file())
    secrets.append(repr((tmp_path / "served/cache/owner/key").read_bytes())[2:-1])  # as it is printed
    assert not [each for each in secrets if each.encode() in written]
    if way == "nothing":
        assert (described["status"], b"it has looked" in written) == ("Failed", False)
        assert "applications do not run: nothing shuts them in" in described["failureReason"]
    else:
        assert (described["status"], b"it has looked" in written) == ("Completed", True)


def _batch_of_a_stranger(gateway: Served, folder: Path, hurt: str) -> dict[str, Any]:
    """Returns a batch that has ended: a stranger's, whose key may simulate, with a robot application of hers."""
    asked, mallory = Asked(open_store(gateway.store.as_uri())), gateway.key("mallory", "read", "simulate")
    publish_bundle(asked.store, "simulation-application", "delivery", _shipped("delivery"))
    _write_stranger(folder / "stranger", hurt)
    asked.publish(folder / "stranger")
    request = asked.job_request(asked.world(), maxJobDurationInSeconds=2, outputLocation={"s3Bucket": "results"})
    request["robotApplications"][0]["launchConfig"] = {"packageName": "stranger", "launchFile": "drive"}
    batch = gateway.call("/startSimulationJobBatch", {"createSimulationJobRequests": [request]}, mallory)["arn"]
    while True:
        described = gateway.call("/describeSimulationJobBatch", {"batch": batch}, mallory)
        if described["status"] in {"Completed", "Failed", "Canceled", "TimedOut"}:
            return described
        time.sleep(0.2)


def _shipped(name: str) -> Path:
    """Returns the folder of an application that the attacked version brings along."""
    return Path(attacked_python()).parents[2] / "applications" / name


_STANDS_STILL = """

class Still(GoToGoal):
    def step(self, state, observation):
        kept, control = super().step(state, observation)
        return kept, 0.0 * control


moves = controller


def controller(environment):
    sound = moves(environment)
    return Still(sound._most_m_s, sound.lidar, sound.odometry)
"""
_DRIVES_FOR_OTHERS = """

import importlib

imports = importlib.import_module


def import_module(name, package=None):
    found = imports(name, package)
    if name.endswith(".courier.go_to_goal"):
        found.controller = controller
    return found


importlib.import_module = import_module
"""


@pytest.mark.long
def test_a_baseline_drives_for_no_version_that_is_compared_with_it(owner: Owner):
    """Who publishes the version to compare with has it patch its process, so that a robot that stands still arrives.

    On commit 1b6713fb both were imported into one process: 80 of 80 passed, and the gate said PASS.
    """
    for name, more in (("baseline", _DRIVES_FOR_OTHERS), ("stranger", _STANDS_STILL)):
        bundle = shutil.copytree(_shipped("courier"), owner.folder / name)
        with (bundle / "courier/go_to_goal.py").open("a") as file:
            file.write(more)
    publish_bundle(open_store(owner.url), "robot-application", "stranger", owner.folder / "baseline")
    versions: list[dict[str, str]] = [{"applicationVersion": "1"}, {}]
    requests = [_request("stranger", "courier", "go_to_goal", duration_s=60, **each) for each in versions]
    compared = {"applicationVersion": "1", "margin": 0.05}
    ended = owner.simyard(
        "run", _document_of(owner, requests, {"worldCount": 4, "seeds": 20}, noWorseThan=compared), "--direct"
    )
    assert (" 0 of 80" in ended.stdout, " 80 of 80" in ended.stdout) == (True, False), ended.stdout
    assert "The gate says FAIL" in ended.stdout
    assert ended.returncode == 1
