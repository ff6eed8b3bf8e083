"""What the shell imports before it answers: nothing that takes a second, and not too much of the rest."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from flows.cli.shell import COMMANDS, load
from specs.job_kinds import JobKind
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.storage.jobs.records import submit
from tasks.storage.store_url import open_store
from tests.factories.planned_batches import begun
from tests.repository import ROOT

QUICKSTART = "examples/quickstart.yaml"
HEAVY = {"jax", "jaxlib", "prefect", "mujoco", "scipy", "numpy", "pyarrow", "fsspec", "s3fs", "botocore", "asyncio"}
# Counted when this was written: 300 to 540; NumPy alone is 140 more.
MOST_MODULES = 600
KINDS: tuple[JobKind, ...] = ("world-generation-job", "pipeline-run")
CODE = """
import json, sys
from contextlib import redirect_stdout
from io import StringIO
from simyard.__main__ import main

sys.argv = ["simyard", *sys.argv[1:]]
try:
    with redirect_stdout(StringIO()) as said:
        main()
except SystemExit as left:
    print(json.dumps({"code": left.code or 0, "said": said.getvalue(), "modules": sorted(sys.modules)}))
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Returns the URL of a store with something to list of each kind."""
    made = open_store((tmp_path_factory.mktemp("shell") / "store").as_uri())
    for kind in KINDS:
        submit(made, kind, {}, "one")
    create_fleet(made, "fleet")
    begun(made)
    return made.url


def imported(*command: str) -> list[str]:
    """Returns the modules that a new process has imported when it has answered."""
    ended = subprocess.run([sys.executable, "-c", CODE, *command], cwd=ROOT, capture_output=True, text=True, check=True)
    answer = json.loads(ended.stdout)
    assert (answer["code"], bool(answer["said"])) == (0, True), ended.stderr
    return answer["modules"]


def assert_light(modules: list[str]) -> None:
    assert sorted(HEAVY.intersection(modules)) == []
    assert len(modules) <= MOST_MODULES


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_the_shell_says_of_a_command_what_its_module_says(name: str):
    assert COMMANDS[name].help == load(name).help.splitlines()[0]


@pytest.mark.parametrize("command", [("--help",), ("list", "--help"), ("validate", QUICKSTART)], ids=" ".join)
def test_help_and_validate_import_little(command: tuple[str, ...]):
    assert_light(imported(*command))


_OTHER_KINDS = ("world-generation-jobs", "fleets", "pipeline-runs")


@pytest.mark.parametrize(
    "kind", ["simulation-job-batches", *(pytest.param(kind, marks=pytest.mark.long) for kind in _OTHER_KINDS)]
)
def test_list_imports_little(store: str, kind: str):
    assert_light(imported("list", kind, "--store", store))


def test_describe_imports_little(store: str):
    batch = begun(open_store(store)).record()
    assert_light(imported("describe", batch.arn, "--store", store))


@pytest.mark.long
def test_plan_imports_little_once_it_knows_the_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    command = ("plan", QUICKSTART, "--store", (tmp_path / "store").as_uri())
    assert "mujoco" in imported(*command)  # for robots that it never saw
    modules = imported(*command)
    # The power of worlds is computed with NumPy and with SciPy's quantiles, which stand once in the tree; the names of
    # arrays' shapes bring asyncio along.
    assert sorted(HEAVY.intersection(modules) - {"numpy", "scipy", "asyncio"}) == []


@pytest.mark.long
def test_the_flows_do_not_import_what_only_some_documents_compute_with():
    code = "import json, sys, flows.prefect.flows; print(json.dumps(sorted(sys.modules)))"
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    # Not botocore: where boto3 is installed, as for these tests, the library of signed metadata imports it.
    heavy = {"jax", "jaxlib", "mujoco", "scipy", "s3fs", "aiobotocore"}
    assert sorted(heavy.intersection(json.loads(ended.stdout))) == []
