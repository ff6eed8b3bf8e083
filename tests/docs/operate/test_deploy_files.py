"""deploy/ parses, names what exists, and agrees with docs/operate/operations.md and prefect.yaml."""

import json
import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from prefect.utilities.schema_tools.validation import is_valid_schema

from tests.integration.stopped.operated import commands, environment, unit
from tests.repository import ROOT
from tests.servers.tools import need_tool

DEPLOY = ROOT / "deploy"
DOCUMENT = (ROOT / "docs/operate/operations.md").read_text()
FILES = sorted(path.name for path in DEPLOY.iterdir())
POOLS = ("docker-pool.json", "kubernetes-pool.json")
UNITS = ("simyard-server", "simyard-worker")


@pytest.mark.parametrize("name", FILES)
def test_every_file_is_named_in_the_document(name: str):
    assert name in DOCUMENT


@pytest.mark.parametrize("name", UNITS)
def test_a_unit_starts_a_program_of_the_environment_with_variables_that_are_there(name: str):
    service = unit(name)

    assert service["ExecStart"].startswith("/opt/simyard/.venv/bin/prefect ")
    assert (DEPLOY / Path(service["EnvironmentFile"]).name).exists()


@pytest.mark.parametrize("name", UNITS)
def test_systemd_understands_a_unit(name: str, tmp_path: Path):
    text = (
        (DEPLOY / f"{name}.service").read_text().replace("/opt/simyard/.venv/bin/prefect", shutil.which("true") or "")
    )
    (tmp_path / f"{name}.service").write_text(text)

    told = subprocess.run(
        [need_tool("systemd-analyze", "systemd"), "verify", "--man=no", str(tmp_path / f"{name}.service")],
        capture_output=True,
        text=True,
        check=False,
    )

    assert [line for line in told.stderr.splitlines() if f"{name}.service" in line] == []


def test_the_worker_serves_the_pool_of_the_deployments():
    pools = {each["work_pool"]["name"] for each in yaml.safe_load((ROOT / "prefect.yaml").read_text())["deployments"]}
    arguments = shlex.split(unit("simyard-worker")["ExecStart"])
    created = commands("docs/operate/operations.md", "deployments")[0]

    assert pools == {arguments[arguments.index("--pool") + 1]} == {created[3]}


def test_the_environments_set_what_the_document_explains():
    explained = set(re.findall(r"^\| `(SIMYARD_\w+)` \|", DOCUMENT, flags=re.MULTILINE))
    assert {name for name in environment("worker") if name.startswith("SIMYARD_")} <= explained


@pytest.mark.parametrize("name", POOLS)
def test_a_pools_template_is_a_schema_whose_variables_are_used_and_explained(name: str):
    template = json.loads((DEPLOY / name).read_text())
    variables = template["variables"]["properties"]
    used = set(re.findall(r"\{\{ (\w+) \}\}", json.dumps(template["job_configuration"])))

    is_valid_schema(template["variables"])
    assert used == set(variables)
    assert [each for each in variables.values() if not (each["title"] and each["description"])] == []


def test_the_manifests_of_kubernetes_name_each_other():
    found = list(yaml.safe_load_all((DEPLOY / "kubernetes.yaml").read_text()))
    names = {(one["kind"], one["metadata"]["name"]) for one in found}
    job = json.loads((DEPLOY / "kubernetes-pool.json").read_text())["job_configuration"]["job_manifest"]
    (container,) = job["spec"]["template"]["spec"]["containers"]
    (worker,) = [one for one in found if one["kind"] == "Deployment"]

    assert ("ConfigMap", container["envFrom"][0]["configMapRef"]["name"]) in names
    assert ("Secret", container["envFrom"][1]["secretRef"]["name"]) in names
    assert ("ServiceAccount", worker["spec"]["template"]["spec"]["serviceAccountName"]) in names
    assert {one["metadata"].get("namespace", "simyard") for one in found} == {"simyard"}


def test_the_dockerfile_copies_what_exists_and_what_the_package_is_built_of():
    lines = (DEPLOY / "Dockerfile").read_text().splitlines()
    copied = [name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]

    assert [name for name in copied if not (ROOT / name).exists()] == []
    assert {*packages, "applications", project["project"]["readme"], "constraints.txt"} <= {*copied}


def test_the_container_of_ros_2_is_run_as_its_own_readme_says():
    (run,) = [line for line in (DEPLOY / "ros2/Dockerfile").read_text().splitlines() if " docker run " in f" {line} "]
    for option in re.findall(r"SIMYARD_[A-Z]+=\w+", run):
        assert option in (DEPLOY / "ros2/README.md").read_text()
    assert "SIMYARD_CONFINEMENT=process" in run  # Docker's own profile lets nobody make namespaces


@pytest.mark.parametrize("name", [name for name in FILES if name.startswith("iam-")])
def test_a_policy_allows_nothing_beside_the_buckets_of_the_example(name: str):
    for statement in _statements(name):
        assert statement["Effect"] == "Allow"
        assert all(action.startswith("s3:") and "*" not in action for action in statement["Action"])
        assert all(re.match(r"arn:aws:s3:::(simyard-store|worlds|results)\b", each) for each in statement["Resource"])


def test_a_robot_writes_its_own_report_and_nothing_else():
    written = [each["Resource"] for each in _statements("iam-robot.json") if "s3:PutObject" in each["Action"]]
    assert written == [["arn:aws:s3:::simyard-store/main/robots/r1/reported.json"]]


def test_no_lifecycle_rule_expires_objects_of_the_store():
    for rule in json.loads((DEPLOY / "lifecycle.json").read_text())["Rules"]:
        assert "Expiration" not in rule


def _statements(name: str) -> list[dict[str, Any]]:
    return cast("list[dict[str, Any]]", json.loads((DEPLOY / name).read_text())["Statement"])
