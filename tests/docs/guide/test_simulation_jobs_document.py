"""docs/guide/simulation-jobs.md names what there is, and its document runs as it stands."""

import re
from pathlib import Path
from typing import get_args

from flows.cli.shell import COMMANDS
from flows.preview.plan import plan_lines
from specs.pipeline.document import PipelineSpec
from specs.robomaker.simulation import SimulationJobBatchStatus, SimulationJobErrorCode
from specs.robomaker.simulation_descriptions import SimulationJobStatus
from tasks.documents.pipeline_file import read_pipeline
from tasks.simulate.data.data_sources import data_variable
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.factories.planned_batches import put_world
from tests.repository import ROOT

PAGE = (ROOT / "docs/guide/simulation-jobs.md").read_text()


def _document(folder: Path) -> PipelineSpec:
    (name, body), *more = re.findall(r"<!-- file: (\S+) -->\n```json\n(.*?)```", PAGE, re.DOTALL)
    assert not more
    (folder / name).write_text(body)
    return read_pipeline(folder / name)


def test_the_old_document_is_planned_as_it_stands(file_store: Store, tmp_path: Path):
    put_world(file_store, "generation-1/world-1")
    open_bucket(file_store, "my-data").put("maps/one", b"1")
    lines = list(plan_lines(_document(tmp_path), tmp_path, file_store))
    assert lines[0].startswith("old-job, on ")
    assert "no effect         simulationBatch.createSimulationJobRequests[*].iamRole" in lines
    assert not any(line.startswith("jobs will fail") for line in lines)


def test_a_file_that_is_not_there_is_told_by_plan_and_refuses_nothing(file_store: Store, tmp_path: Path):
    put_world(file_store, "generation-1/world-1")
    lines = list(plan_lines(_document(tmp_path), tmp_path, file_store))
    reason = "InvalidS3Resource: data source maps: there is nothing below my-data/maps/"
    assert f"jobs will fail    {reason}" in lines


def _first_column(heading: str) -> list[str]:
    table = PAGE.partition(f"| {heading} |")[2].partition("\n\n")[0]
    cells = [line.split("|")[1] for line in table.splitlines()[2:]]
    return [name for cell in cells for name in re.findall("`([A-Za-z]+)`", cell)]


def test_the_states_are_robomakers():
    assert set(_first_column("of a batch")) == set(get_args(SimulationJobBatchStatus)) - {"Failed"}
    # Nothing ends without a reason.
    assert set(_first_column("of a job")) == set(get_args(SimulationJobStatus)) - {"Terminated"}


def test_the_codes_are_robomakers():
    named = set(re.findall(r"\| `([A-Z][A-Za-z0-9]+)` \|$", PAGE, re.MULTILINE))
    assert named == {"InvalidS3Resource", "BadPermissionsS3Object", "MismatchedEtag", "LimitExceeded", "InvalidInput"}
    assert named <= set(get_args(SimulationJobErrorCode))


def test_the_commands_exist():
    assert set(re.findall("`simyard ([a-z]+)", PAGE)) <= COMMANDS.keys()


def test_a_variable_is_named_as_the_page_says():
    assert data_variable("my-maps") == "DATA_SOURCE_MY_MAPS"
